"""Degeneracy of weighted particles, particles that are no sample of the posterior, impossible data, and draws that are NaN."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.efficiency import ESS_LOW
from poseppl.diagnostics.selection import provenance_table
from poseppl.diagnostics.verdicts.verdict import (
    ERROR,
    WARNING,
    Findings,
    Remedy,
    Verdict,
    not_run,
    settings_among,
    statistic,
    where,
)
from poseppl.runs.contents import flat_draws, group_of
from poseppl.runs.results import is_weighted, provenance

LOW_SHARE = 0.1
"""Share of frames with few effective particles above which they are an error: a filter finds back from single ones."""


def mode_seeking(tree: xr.DataTree) -> Findings:
    """Results of optimizers, whose spread means nothing: of mode-seeking filters, and most probable trajectories."""
    if provenance(tree).get("optimizer"):
        text = "The smoother returns one trajectory, the most probable one: its standard deviations and intervals mean nothing"
        yield Verdict(WARNING, f"{text}. For these, use another smoother (poseppl smoothers).")
        return
    if not _seeks_mode(tree):
        yield from [] if is_weighted(tree) else [not_run()]
        return
    target = (Remedy("use {}", "target", "posterior", setting=True),)
    others = target if "target" in provenance_table(tree, "settings") else suited_filter(tree)
    text = "The filter seeks a mode and does not sample the posterior: its standard deviations and intervals mean nothing"
    yield Verdict(ERROR, f"{text}. For these," if others else f"{text}.", others)


def degeneracy(tree: xr.DataTree) -> Findings:
    """Degeneracy of weighted particles."""
    exact = provenance(tree).get("closed form")  # whose weights are so, however few there are
    if not is_weighted(tree) or exact or _seeks_mode(tree):
        yield not_run()
        return
    number, more = int(tree.attrs["num_particles"]), settings_among(tree, "num_particles")
    effective, unique = statistic(tree, "ess"), statistic(tree, "unique_ancestors")
    if effective is not None and (effective < ESS_LOW).any():
        low, least = effective < ESS_LOW, f"{np.nanmin(effective):.1f}"
        text = f"Effective number of particles below {ESS_LOW:.0f} of {number} in {where(tree, low)} (least {least})"
        severity = ERROR if low.mean() > LOW_SHARE else WARNING
        yield Verdict(severity, f"{text}: the particles miss the posterior;", (*more, *suited_filter(tree)))
    if unique is not None:
        few = unique < min(ESS_LOW, number)
        few[0] = False  # no resampling comes before the first frame
        if few.any():
            text = f"Fewer than {ESS_LOW:.0f} particles have descendants in {where(tree, few)} (least {unique[few].min():.0f})"
            yield Verdict(WARNING, f"{text}: the sample is impoverished;", more)


def _seeks_mode(tree: xr.DataTree) -> bool:
    """Whether the particles are those of a filter that has no evidence, or of a smoother that is bound to them."""
    return is_weighted(tree) and provenance(tree).get("evidence") == "none"


def suited_filter(tree: xr.DataTree) -> tuple[Remedy, ...]:
    """The best other filter that takes the model; none where there is none."""
    known = provenance(tree)
    others = [str(name) for name in known.get("suited filters") or [] if name != known.get("filter")]
    return tuple(Remedy("use {}", "filter", name) for name in others[:1])


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
