"""Peursum, Venkatesh and West (2010): a body of 28 dimensions, its likelihood and a factored motion model."""
