"""Recorded and simulated motion: subjects, placed cameras, the truth."""
