"""Image features for likelihoods: foreground, edges, distances, colours, contours and flow, as plain NumPy arrays."""

from __future__ import annotations

from poseppl.vision.background import Background as Background
from poseppl.vision.background import BackgroundSettings as BackgroundSettings
from poseppl.vision.background import Foreground as Foreground
from poseppl.vision.background import background_from_plate as background_from_plate
from poseppl.vision.background import learn_background as learn_background
from poseppl.vision.cache import feature_key as feature_key
from poseppl.vision.cache import read_features as read_features
from poseppl.vision.cache import video_features as video_features
from poseppl.vision.cache import write_features as write_features
from poseppl.vision.colour import ColourSettings as ColourSettings
from poseppl.vision.colour import bhattacharyya_distance as bhattacharyya_distance
from poseppl.vision.colour import colour_bins as colour_bins
from poseppl.vision.colour import colour_histogram as colour_histogram
from poseppl.vision.colour import weighted_distance as weighted_distance
from poseppl.vision.contours import descriptor_distance as descriptor_distance
from poseppl.vision.contours import fourier_descriptors as fourier_descriptors
from poseppl.vision.contours import outer_contour as outer_contour
from poseppl.vision.edges import EdgeSettings as EdgeSettings
from poseppl.vision.edges import benchmark_edge_map as benchmark_edge_map
from poseppl.vision.edges import edge_proximity as edge_proximity
from poseppl.vision.edges import find_edges as find_edges
from poseppl.vision.edges import gradient as gradient
from poseppl.vision.features import FeatureSettings as FeatureSettings
from poseppl.vision.features import FrameFeatures as FrameFeatures
from poseppl.vision.features import extract as extract
from poseppl.vision.features import scale_image as scale_image
from poseppl.vision.features import scale_mask as scale_mask
from poseppl.vision.flow import FlowSettings as FlowSettings
from poseppl.vision.flow import dense_flow as dense_flow
from poseppl.vision.flow import flow_outliers as flow_outliers
from poseppl.vision.flow import foreground_flow as foreground_flow
from poseppl.vision.maps import box_sum as box_sum
from poseppl.vision.maps import edge_distance as edge_distance
from poseppl.vision.maps import integral_image as integral_image
from poseppl.vision.maps import silhouette_distance as silhouette_distance
from poseppl.vision.masks import check_mask as check_mask
from poseppl.vision.masks import clean_mask as clean_mask
from poseppl.vision.masks import keep_together as keep_together
from poseppl.vision.picture import features_picture as features_picture
from poseppl.vision.picture import save_features_picture as save_features_picture
from poseppl.vision.refinement import refine_mask as refine_mask
