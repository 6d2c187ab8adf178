"""Verdicts and tables of the documentation, made from the tables that are committed beside it."""
