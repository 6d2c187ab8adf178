"""Filters as single papers published them: to reproduce those papers, or for a pose without intervals."""
