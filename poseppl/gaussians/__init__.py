"""Gaussians and mixtures of them: linearisation, expectation maximisation, precision matrices of whole trajectories."""
