"""Image features for likelihoods: foreground, edges, distances, colours, contours and flow, as plain NumPy arrays."""

from __future__ import annotations

from poseppl.motion.vision.background import (
    Background as Background,
    BackgroundSettings as BackgroundSettings,
    Foreground as Foreground,
    background_from_plate as background_from_plate,
    learn_background as learn_background,
    refine_mask as refine_mask,
)
from poseppl.motion.vision.cache import feature_key as feature_key, video_features as video_features
from poseppl.motion.vision.colour import (
    ColourSettings as ColourSettings,
    bhattacharyya_distance as bhattacharyya_distance,
    colour_bins as colour_bins,
    colour_histogram as colour_histogram,
)
from poseppl.motion.vision.contours import fourier_descriptors as fourier_descriptors, outer_contour as outer_contour
from poseppl.motion.vision.edges import (
    EdgeSettings as EdgeSettings,
    benchmark_edge_map as benchmark_edge_map,
    edge_distance as edge_distance,
    edge_proximity as edge_proximity,
    find_edges as find_edges,
    gradient as gradient,
    silhouette_distance as silhouette_distance,
)
from poseppl.motion.vision.features import (
    FeatureSettings as FeatureSettings,
    FrameFeatures as FrameFeatures,
    extract as extract,
    features_picture as features_picture,
    scale_image as scale_image,
    scale_mask as scale_mask,
)
from poseppl.motion.vision.flow import (
    FlowSettings as FlowSettings,
    dense_flow as dense_flow,
    flow_outliers as flow_outliers,
    foreground_flow as foreground_flow,
)
from poseppl.motion.vision.image_cues import (
    EnergySettings as EnergySettings,
    WeightSettings as WeightSettings,
    edge_energy as edge_energy,
    flow_weights as flow_weights,
    motion_boundaries as motion_boundaries,
)
from poseppl.motion.vision.masks import check_mask as check_mask, clean_mask as clean_mask, keep_together as keep_together
