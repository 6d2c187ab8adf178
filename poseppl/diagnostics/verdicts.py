"""The diagnostics in words: what is wrong with a result, where, and what to do about it, the gravest first.

>>> frame_ranges([14, 15, 16, 17, 20])
'frames 14-17, 20'
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from poseppl.diagnostics.diagnosis import diagnose
from poseppl.results import is_weighted

GRAVE, DOUBTFUL, REMARK = "grave", "doubtful", "remark"
_ORDER = (GRAVE, DOUBTFUL, REMARK)

TAU_BAD = 25.0
ESS_LOW = 10.0
RHAT_HIGH = 1.2
REJECTION_HIGH = 0.4
REJECTION_LOW = 0.01
MAX_NAMED = 4
MAX_RANGES = 6
_LEVEL = 0.9
_SLACK = 0.03


class Verdict(NamedTuple):
    """One finding: its ``severity`` ("grave", "doubtful" or "remark") and the sentence."""

    severity: str
    text: str


def verdicts(tree: xr.DataTree) -> list[Verdict]:
    """Judge a result.

    Args:
        tree: The result; diagnosed first if it has no group ``diagnostics``.

    Returns:
        Findings, the gravest first; a single remark if there is nothing to complain of.
    """
    whole = tree if "diagnostics" in tree.children else diagnose(tree)
    found = [
        *_failures(whole),
        *_coverage(whole),
        *_degeneracy(whole),
        *_divergences(whole),
        *_mixing(whole),
        *_agreement(whole),
        *_rejection(whole),
        *_missing(whole),
    ]
    found.sort(key=lambda verdict: _ORDER.index(verdict.severity))
    if all(verdict.severity == REMARK for verdict in found):
        found.insert(0, Verdict(REMARK, "Nothing to complain of."))
    return found


def frame_ranges(frames: Iterable[int], limit: int = MAX_RANGES) -> str:
    """Name frames in words, neighbours merged.

    Args:
        frames: Frame numbers.
        limit: The most ranges to spell out.

    Returns:
        Such as "frame 3" or "frames 3-7, 12 and 4 more".
    """
    numbers = np.unique(np.asarray(list(frames), dtype=np.int64))
    if len(numbers) == 0:
        return "no frame"
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    words = [str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs]
    rest = sum(len(run) for run in runs[limit:])
    tail = f" and {rest} more" if rest else ""
    return f"{'frame' if len(numbers) == 1 else 'frames'} {', '.join(words[:limit])}{tail}"


def _where(tree: xr.DataTree, mask: ArrayLike) -> str:
    frames: NDArray[np.int64] = tree["posterior"].dataset["frame"].values
    chosen = np.asarray(mask, bool)
    if chosen.all() and len(chosen) > 1:
        return "every frame"
    return frame_ranges(frames[chosen].tolist())


def _statistic(tree: xr.DataTree, name: str) -> NDArray[np.float64] | None:
    if "sample_stats" not in tree.children or name not in tree["sample_stats"].dataset:
        return None
    return np.asarray(tree["sample_stats"].dataset[name].values, np.float64)


def _failures(tree: xr.DataTree) -> list[Verdict]:
    failed, evidence = _statistic(tree, "failed"), _statistic(tree, "log_evidence")
    found = []
    broken = np.zeros(tree["posterior"].sizes["frame"], bool)
    if failed is not None and failed.any():
        broken = failed > 0
        found.append(
            Verdict(
                GRAVE,
                f"Impossible data in {_where(tree, broken)}: no draw explains them, and the posterior there is the prior.",
            )
        )
    if evidence is not None and (np.isneginf(evidence) & ~broken).any():
        found.append(Verdict(GRAVE, f"The evidence is zero in {_where(tree, np.isneginf(evidence) & ~broken)}."))
    empty = ~np.isfinite(tree["posterior"].dataset["state"].values).all(axis=(0, 1, 3))
    if empty.any():
        found.append(Verdict(GRAVE, f"Draws that are not finite in {_where(tree, empty)}."))
    return found


def _coverage(tree: xr.DataTree) -> list[Verdict]:
    data = tree["diagnostics"].dataset
    if "coverage" not in data:
        return []
    share, error = (float(data[name].sel(level=_LEVEL)) for name in ("coverage", "coverage_se"))
    if not np.isfinite(share):
        return []
    text = f"90 % intervals cover {100 * share:.0f} % (± {100 * error:.0f}) of the truth"
    if share + 2 * error < _LEVEL - _SLACK:
        advice = "over-confident, its intervals are too narrow"
        return [Verdict(GRAVE if share < 0.75 else DOUBTFUL, f"{text}: {advice}.")]
    if share - 2 * error > _LEVEL + _SLACK:
        return [Verdict(DOUBTFUL, f"{text}: under-confident, its intervals are too wide.")]
    return [Verdict(REMARK, f"{text}: calibrated as far as this sequence can tell.")]


def _degeneracy(tree: xr.DataTree) -> list[Verdict]:
    """What weighted particles suffer from."""
    if not is_weighted(tree):
        return []
    number = int(tree.attrs["num_particles"])
    found = []
    effective = _statistic(tree, "ess")
    if effective is not None:
        low = effective < ESS_LOW
        if low.any():
            worst = np.nanmin(effective)
            text = f"Effective number of particles below {ESS_LOW:.0f} of {number} in {_where(tree, low)} (least {worst:.1f})"
            found.append(Verdict(GRAVE, f"{text}: the particles miss the posterior; use more, or an HMC filter."))
    unique = _statistic(tree, "unique_ancestors")
    if unique is not None:
        few = unique < min(ESS_LOW, number)
        few[0] = False  # no resampling comes before the first frame
        if few.any():
            text = f"Fewer than {ESS_LOW:.0f} particles have descendants in {_where(tree, few)} (least {unique[few].min():.0f})"
            found.append(Verdict(DOUBTFUL, f"{text}: the sample is impoverished."))
    return found


def _divergences(tree: xr.DataTree) -> list[Verdict]:
    counts = _statistic(tree, "divergences")
    if counts is None or not (counts > 0).any():
        return []
    share = float((counts > 0).mean())
    text = f"Divergences in {_where(tree, counts > 0)} ({counts.sum():.0f} in all): the step size is too large there"
    return [Verdict(GRAVE if share > 0.2 else DOUBTFUL, f"{text}.")]


def _mixing(tree: xr.DataTree) -> list[Verdict]:
    """Coordinates with large inefficiency factors, the worst by name, and frames of few effective draws."""
    data = tree["diagnostics"].dataset
    if is_weighted(tree):
        return []
    tau, ess = np.asarray(data["tau"].values), np.asarray(data["ess"].values)
    names = [str(name) for name in data["dof"].values]
    found = []
    bad = tau > TAU_BAD
    affected = [i for i in np.argsort(-np.where(bad, tau, 0.0).max(axis=0), kind="stable") if bad[:, i].any()]
    for i in affected[:MAX_NAMED]:
        worst = float(tau[bad[:, i], i].max())
        text = f"{names[i]} mixes badly: tau = {worst:.0f} in {_where(tree, bad[:, i])}"
        found.append(Verdict(GRAVE if bad[:, i].mean() > 0.5 else DOUBTFUL, f"{text}."))
    if len(affected) > MAX_NAMED:
        others = np.array(affected[MAX_NAMED:])
        text = f"{len(others)} other coordinates mix badly (tau up to {tau[:, others][bad[:, others]].max():.0f})"
        found.append(Verdict(DOUBTFUL, f"{text} in {_where(tree, bad[:, others].any(axis=1))}."))
    low = (ess < ESS_LOW).any(axis=1)
    if low.any():
        worst_dof = names[int(np.nanargmin(np.where(np.isnan(ess), np.inf, ess).min(axis=0)))]
        text = f"ESS below {ESS_LOW:.0f} in {_where(tree, low)} (least {np.nanmin(ess):.1f}, {worst_dof})"
        found.append(Verdict(DOUBTFUL, f"{text}: means and intervals are rough; draw more."))
    if np.isnan(tau).all():
        found.append(Verdict(DOUBTFUL, "Mixing cannot be judged: too few draws a chain were kept."))
    return found


def _agreement(tree: xr.DataTree) -> list[Verdict]:
    data = tree["diagnostics"].dataset
    if "rhat" not in data or np.isnan(data["rhat"].values).all():
        return []
    rhat = data["rhat"].values
    high = rhat > RHAT_HIGH
    if high.mean() < 0.02:
        return []
    frame, dof = np.unravel_index(int(np.nanargmax(rhat)), rhat.shape)
    worst = f"{rhat[frame, dof]:.2f}, {data['dof'].values[dof]} in frame {data['frame'].values[frame]}"
    text = f"R-hat above {RHAT_HIGH} in {100 * high.mean():.0f} % of frames and coordinates (largest {worst})"
    return [Verdict(GRAVE if high.mean() > 0.5 else DOUBTFUL, f"{text}: the chains disagree.")]


def _rejection(tree: xr.DataTree) -> list[Verdict]:
    data = tree["diagnostics"].dataset
    if "rejection_rate" not in data or is_weighted(tree):
        return []
    rate = data["rejection_rate"].values
    found = []
    high = rate > REJECTION_HIGH
    if high.any():
        text = f"Rejection rate up to {100 * rate[high].max():.0f} % in {_where(tree, high)}: the step size is too large"
        found.append(Verdict(GRAVE if np.nanmean(rate) > REJECTION_HIGH else DOUBTFUL, f"{text}."))
    if np.nanmean(rate) < REJECTION_LOW:
        found.append(Verdict(REMARK, "Hardly a proposal is rejected: a larger step size would save time."))
    return found


def _missing(tree: xr.DataTree) -> list[Verdict]:
    if "observed_data" not in tree.children or "points" not in tree["observed_data"].dataset:
        return []
    points = tree["observed_data"].dataset["points"].values
    seen = np.isfinite(points).reshape(len(points), -1)
    blind = ~seen.any(axis=1)
    if blind.any():
        return [Verdict(REMARK, f"Nothing was observed in {_where(tree, blind)}: the posterior there is the prediction.")]
    return []
