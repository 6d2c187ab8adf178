"""Named points of anything, smoothed in three dimensions."""
