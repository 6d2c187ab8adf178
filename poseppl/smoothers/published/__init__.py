"""Smoothers as single papers published them: to reproduce those papers, and to compare with."""
