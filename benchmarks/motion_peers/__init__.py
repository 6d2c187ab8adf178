"""Points in space from a detector's keypoints, by libraries of their own: anipose, Pose2Sim, EKS, and poseppl beside them."""
