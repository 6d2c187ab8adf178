"""Generative models as NumPyro programs: bodies, observation processes and toys with known answers."""
