"""Sequential Bayesian inference in high-dimensional state-space models written as NumPyro programs."""
