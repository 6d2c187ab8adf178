"""A detector's keypoints: read, associate, synchronise, refine the cameras, correct detections, measure the noise."""
