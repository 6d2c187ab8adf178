"""Models with known answers."""
