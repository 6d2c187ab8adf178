"""Figures of repeated runs: variance of the posterior mean against time, and the log-evidence with its Monte Carlo error.

Runs of one setting and of different seeds are replicates: the sample variance of their means, over the posterior variance, is
averaged over frames and degrees of freedom, with its jackknife error over seeds; of two seeds that error is sqrt(2) times the
variance, as if all frames went together. A setting with one seed has its own estimate, the average of 1 / ESS, with the error
of batches of frames: it does not know what the past of the filter adds, nor the bias of a run that misses part of the
posterior. The posterior variance is the median over all runs, the same for all points, so that a run whose posterior has
collapsed gains nothing by it.

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

from poseppl.arrays import Floats
from poseppl.diagnostics.batches import mean_interval
from poseppl.diagnostics.run_figures import FORMULA, kind_of_run
from poseppl.runs.contents import group_of
from poseppl.runs.results import provenance


class Spread(NamedTuple):
    """Variance of a mean over the posterior variance, and its standard error: each (state_dim,), or of all together."""

    variance: Floats
    standard_error: Floats


def variance_against_time(figures: xr.Dataset) -> xr.Dataset:
    """Compute the points of the settings.

    Args:
        figures: The figures of all runs, with a dimension ``run``.

    Returns:
        Over ``setting``, whose name is that of its first run: ``method``, ``replicates`` (seeds), ``seconds`` (a frame),
        ``seconds_se``, ``variance`` and ``variance_se``, and by ``state_dim`` ``variance_by_state_dim`` and
        ``variance_by_state_dim_se``.
    """
    reference = (figures["sd"] ** 2).median("run", skipna=False)
    groups = settings_of_runs(figures)
    points = [_point(figures.isel(run=group), reference.where(reference > 0)) for group in groups]
    return xr.concat(points, dim="setting").assign_coords(setting=[figures["run"].values[group[0]] for group in groups])


def _point(runs: xr.Dataset, reference: xr.DataArray) -> xr.Dataset:
    (total, total_error), (each, each_error) = _spread(runs, reference)
    seconds = runs["seconds"].values
    data = {
        "method": runs["method"].values[0],
        "replicates": len(seconds),
        "seconds": seconds.mean(),
        "seconds_se": seconds.std(ddof=1) / np.sqrt(len(seconds)) if len(seconds) > 1 else np.nan,
        "variance": total,
        "variance_se": total_error,
        "variance_by_state_dim": ("state_dim", each),
        "variance_by_state_dim_se": ("state_dim", each_error),
    }
    return xr.Dataset(data, coords={"state_dim": runs["state_dim"].values})


def settings_of_runs(figures: xr.Dataset) -> list[list[int]]:
    """Indices of the runs of each setting; a run without a known setting is a group of its own, and a seed counts once."""
    found: dict[str, dict[str, int]] = {}
    for index, (setting, seed) in enumerate(zip(figures["setting"].values, figures["seed"].values, strict=True)):
        known = str(setting) != "{}" and str(seed)
        found.setdefault(str(setting) if known else f"run {index}", {}).setdefault(str(seed), index)
    return [list(seeds.values()) for seeds in found.values()]


def _spread(runs: xr.Dataset, reference: xr.DataArray) -> tuple[Spread, Spread]:
    """Variance of all degrees of freedom together, and of each."""
    if runs.sizes["run"] > 1:
        squares = (runs["mean"] - runs["mean"].mean("run", skipna=False)) ** 2 / reference
        return _between(squares.mean(("frame", "state_dim")).values), _between(squares.mean("frame").values)
    inverse = 1 / runs["ess"].isel(run=0)
    each = np.array([mean_interval(inverse.isel(state_dim=state_dim))[:2] for state_dim in range(inverse.sizes["state_dim"])]).T
    return Spread(*np.array(mean_interval(inverse.mean("state_dim"))[:2])), Spread(*each)


def _between(squares: Floats) -> Spread:
    """From squared distances from the mean over seeds (seed, ...): the sample variance, and its jackknife error over seeds.

    Leaving seed s out of S leaves a sum of squares less by S / (S - 1) of its own.
    """
    count = len(squares)
    variance = np.asarray(squares.sum(axis=0) / (count - 1))
    if count == 2:
        return Spread(variance, np.sqrt(2.0) * variance)
    left = (squares.sum(axis=0) - squares * count / (count - 1)) / (count - 2)
    return Spread(variance, np.sqrt((count - 1) / count * np.square(left - left.mean(axis=0)).sum(axis=0)))


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
