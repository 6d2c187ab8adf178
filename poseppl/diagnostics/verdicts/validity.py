"""Data that were impossible or absent, and draws that are no numbers."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.verdicts.verdict import ERROR, WARNING, Findings, Verdict, not_run, statistic, where
from poseppl.runs.contents import flat_draws, group_of
from poseppl.runs.results import provenance


def failures(tree: xr.DataTree) -> Findings:
    """Frames of impossible data, of zero evidence, and of draws that are not finite."""
    failed, evidence = statistic(tree, "failed"), statistic(tree, "log_evidence")
    broken = np.zeros(tree["posterior"].sizes["frame"], bool) if failed is None else failed > 0
    if broken.any():
        text = f"Data with zero likelihood in {where(tree, broken)}"
        yield Verdict(ERROR, f"{text}: no draw explains them, and the posterior there is the prediction.")
    if evidence is not None and (np.isneginf(evidence) & ~broken).any():
        yield Verdict(ERROR, f"The evidence is zero in {where(tree, np.isneginf(evidence) & ~broken)}.")
    empty = ~np.isfinite(flat_draws(tree).values).all(axis=(0, 1, 3))
    if empty.any():
        yield Verdict(ERROR, f"Draws that are not finite in {where(tree, empty)}.")


def run_warnings(tree: xr.DataTree) -> Findings:
    """Warnings of the run itself, which are no check of its result."""
    yield not_run()
    found = provenance(tree).get("warnings", [])
    for text in found if isinstance(found, list) else []:
        yield Verdict(WARNING, f"The run warned: {text}.")


def missing(tree: xr.DataTree) -> Findings:
    """Data of which nothing was observed."""
    observed = group_of(tree, "observed_data")
    if len(observed) and not any(np.isfinite(values).any() for values in observed.values()):
        yield Verdict(WARNING, "Nothing was observed in any frame: the posterior is the prior.")
