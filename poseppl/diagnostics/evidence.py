r"""The log-evidence of runs, with its Monte Carlo error, and which differences are more than chance.

With three or more runs of one setting and different seeds, the error is their standard deviation. A single run
of a particle filter has that of its own frames,

    Var log p(z_1..T)  ~  sum over t of  (1 / ESS_t - 1 / N),

the relative variance of each frame's mean weight (delta method), frames taken to err on their own; what a frame's particles owe
to earlier choices is left out, so that it is somewhat low. A filter of a closed form has none. The error is unknown for chains,
tempering and deterministic approximations: run them with three seeds. Filters that seek a mode have no evidence, and neither
have smoothers. Which it is, the filter says of itself (:class:`poseppl.filters.base.Filter`), and the result after it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from poseppl.diagnostics.replicates import settings_of_runs
from poseppl.diagnostics.run_figures import FORMULA, kind_of_run
from poseppl.runs.contents import group_of
from poseppl.runs.results import provenance

REPLICATES, WEIGHTS, NONE, UNKNOWN = "replicates", "weights", "none", "unknown"
_MIN_SEEDS = 3
_SURE = 2.0


class Evidence(NamedTuple):
    """The log-evidence of a run (NaN without one), its standard error (NaN if unknown), and where that comes from."""

    log_evidence: float
    standard_error: float
    source: str


def evidence_of_run(tree: xr.DataTree) -> Evidence:
    """Log-evidence of all frames of a result, with the error that the run itself knows."""
    known = provenance(tree)
    stats = group_of(tree, "sample_stats")
    source = known.get("evidence")
    if "log_evidence" not in stats or "smoother" in known or source == NONE:
        return Evidence(float("nan"), float("nan"), NONE)
    total = float(np.sum(stats["log_evidence"].values.astype(np.float64)))
    if kind_of_run(tree) == FORMULA:
        return Evidence(total, 0.0, FORMULA)
    if source == WEIGHTS and "num_particles" in tree.attrs:
        lost = 1 / np.maximum(stats["ess"].values.astype(np.float64), 1.0) - 1 / float(tree.attrs["num_particles"])
        return Evidence(total, float(np.sqrt(np.maximum(lost, 0.0).sum())), WEIGHTS)
    return Evidence(total, float("nan"), UNKNOWN)


def evidences(found: list[Evidence], figures: xr.Dataset) -> xr.Dataset:
    """Evidences of runs, with errors from replicates where there are enough.

    Args:
        found: Evidence of each run.
        figures: The figures of all runs, with a dimension ``run``.

    Returns:
        Over ``run``: ``log_evidence``, ``standard_error`` and ``source``; and ``beyond_noise`` (run, other), whether two runs
        differ by more than two standard errors of their difference.
    """
    runs = list(found)
    for group in settings_of_runs(figures):
        values = np.array([found[index].log_evidence for index in group])
        if len(group) >= _MIN_SEEDS and np.isfinite(values).all() and found[group[0]].source != FORMULA:
            for index in group:
                runs[index] = found[index]._replace(standard_error=float(values.std(ddof=1)), source=REPLICATES)
    total, error, source = map(np.array, zip(*runs, strict=True))
    with np.errstate(invalid="ignore"):
        apart = np.abs(total[:, None] - total) > _SURE * np.hypot(error[:, None], error)
    data = {"log_evidence": ("run", total), "standard_error": ("run", error), "source": ("run", source)}
    names = figures["run"].values
    return xr.Dataset(data, coords={"run": names, "other": names}).assign(beyond_noise=(("run", "other"), apart))


def evidence_words(row: xr.Dataset) -> str:
    """One of :func:`evidences`, such as "-123.4 ± 0.6", a question mark for an unknown error; a dash without an evidence."""
    total, error = row["log_evidence"].item(), row["standard_error"].item()
    if not np.isfinite(total):
        return "–"
    return f"{total:.1f}" + ("" if error == 0 else f" ± {error:.2g}" if np.isfinite(error) else " ± ?")
