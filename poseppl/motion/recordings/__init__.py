"""Recorded and simulated motion: subjects, and the truth."""
