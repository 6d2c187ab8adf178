"""Remedies as options of the command line.

>>> as_option(Remedy("use {}", "walk", "learned")), as_option(Remedy("raise {}", "num_chains", setting=True))
('--walk learned', '--set num_chains')
"""

from __future__ import annotations

from poseppl.diagnostics.verdicts.verdict import Remedy


def as_option(remedy: Remedy) -> str:
    """A remedy's argument and value as an option."""
    if remedy.setting:
        return f"--set {remedy.argument}" + ("" if remedy.value is None else f"={remedy.value}")
    return f"--{remedy.argument.replace('_', '-')}" + ("" if remedy.value is None else f" {remedy.value}")
