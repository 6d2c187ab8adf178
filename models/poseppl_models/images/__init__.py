"""What the image-based systems of several papers share."""
