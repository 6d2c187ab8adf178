"""People in cameras: bodies, geometry, likelihoods, files of recordings, vision, rendering and tracking."""
