"""Image features for likelihoods: foreground, edges, distances, colours, contours and flow, as plain NumPy arrays."""

from __future__ import annotations

from poseppl.motion.vision.background import Background as Background
from poseppl.motion.vision.background import BackgroundSettings as BackgroundSettings
from poseppl.motion.vision.background import Foreground as Foreground
from poseppl.motion.vision.background import background_from_plate as background_from_plate
from poseppl.motion.vision.background import learn_background as learn_background
from poseppl.motion.vision.cache import feature_key as feature_key
from poseppl.motion.vision.cache import video_features as video_features
from poseppl.motion.vision.colour import ColourSettings as ColourSettings
from poseppl.motion.vision.colour import bhattacharyya_distance as bhattacharyya_distance
from poseppl.motion.vision.colour import colour_bins as colour_bins
from poseppl.motion.vision.colour import colour_histogram as colour_histogram
from poseppl.motion.vision.colour import weighted_distance as weighted_distance
from poseppl.motion.vision.contours import fourier_descriptors as fourier_descriptors
from poseppl.motion.vision.contours import outer_contour as outer_contour
from poseppl.motion.vision.edge_energy import EnergySettings as EnergySettings
from poseppl.motion.vision.edge_energy import edge_energy as edge_energy
from poseppl.motion.vision.edge_energy import motion_boundaries as motion_boundaries
from poseppl.motion.vision.edges import EdgeSettings as EdgeSettings
from poseppl.motion.vision.edges import benchmark_edge_map as benchmark_edge_map
from poseppl.motion.vision.edges import edge_proximity as edge_proximity
from poseppl.motion.vision.edges import find_edges as find_edges
from poseppl.motion.vision.edges import gradient as gradient
from poseppl.motion.vision.features import FeatureSettings as FeatureSettings
from poseppl.motion.vision.features import FrameFeatures as FrameFeatures
from poseppl.motion.vision.features import extract as extract
from poseppl.motion.vision.features import scale_image as scale_image
from poseppl.motion.vision.features import scale_mask as scale_mask
from poseppl.motion.vision.flow import FlowSettings as FlowSettings
from poseppl.motion.vision.flow import dense_flow as dense_flow
from poseppl.motion.vision.flow import flow_outliers as flow_outliers
from poseppl.motion.vision.flow import foreground_flow as foreground_flow
from poseppl.motion.vision.maps import edge_distance as edge_distance
from poseppl.motion.vision.maps import silhouette_distance as silhouette_distance
from poseppl.motion.vision.masks import check_mask as check_mask
from poseppl.motion.vision.masks import clean_mask as clean_mask
from poseppl.motion.vision.masks import keep_together as keep_together
from poseppl.motion.vision.picture import features_picture as features_picture
from poseppl.motion.vision.picture import save_features_picture as save_features_picture
from poseppl.motion.vision.refinement import refine_mask as refine_mask
