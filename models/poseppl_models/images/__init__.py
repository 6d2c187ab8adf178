"""Common parts of the image-based systems of several papers."""
