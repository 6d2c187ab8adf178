"""Weights, resampling, prefix sums and keys: what every particle method is made of."""
