"""Mixing of Markov chains: divergences, rejection, inefficiency, agreement."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.verdicts.verdict import ERROR, ESS_LOW, INFO, WARNING, Verdict, statistic, where
from poseppl.results import is_weighted

TAU_BAD = 25.0
RHAT_HIGH = 1.2
REJECTION_HIGH = 0.4
REJECTION_LOW = 0.01
MAX_NAMED = 4


def divergences(tree: xr.DataTree) -> list[Verdict]:
    """Divergent trajectories."""
    counts = statistic(tree, "divergences")
    if counts is None or not (counts > 0).any():
        return []
    share = float((counts > 0).mean())
    text = f"Divergences in {where(tree, counts > 0)} ({counts.sum():.0f} in all): the step size is too large there"
    return [Verdict(ERROR if share > 0.2 else WARNING, f"{text}.")]


def mixing(tree: xr.DataTree) -> list[Verdict]:
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
        text = f"{names[i]} mixes badly: tau = {worst:.0f} in {where(tree, bad[:, i])}"
        found.append(Verdict(ERROR if bad[:, i].mean() > 0.5 else WARNING, f"{text}."))
    if len(affected) > MAX_NAMED:
        others = np.array(affected[MAX_NAMED:])
        text = f"{len(others)} other coordinates mix badly (tau up to {tau[:, others][bad[:, others]].max():.0f})"
        found.append(Verdict(WARNING, f"{text} in {where(tree, bad[:, others].any(axis=1))}."))
    low = (ess < ESS_LOW).any(axis=1)
    if low.any():
        worst_dof = names[int(np.nanargmin(np.where(np.isnan(ess), np.inf, ess).min(axis=0)))]
        text = f"ESS below {ESS_LOW:.0f} in {where(tree, low)} (least {np.nanmin(ess):.1f}, {worst_dof})"
        found.append(Verdict(WARNING, f"{text}: means and intervals are rough; draw more."))
    if np.isnan(tau).all():
        found.append(Verdict(WARNING, "Mixing cannot be judged: too few draws a chain were kept."))
    return found


def agreement(tree: xr.DataTree) -> list[Verdict]:
    """Chains that disagree, by R-hat."""
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
    return [Verdict(ERROR if high.mean() > 0.5 else WARNING, f"{text}: the chains disagree.")]


def rejection(tree: xr.DataTree) -> list[Verdict]:
    """Rejection rates that are too high or too low."""
    data = tree["diagnostics"].dataset
    if "rejection_rate" not in data or is_weighted(tree):
        return []
    rate = data["rejection_rate"].values
    found = []
    high = rate > REJECTION_HIGH
    if high.any():
        text = f"Rejection rate up to {100 * rate[high].max():.0f} % in {where(tree, high)}: the step size is too large"
        found.append(Verdict(ERROR if np.nanmean(rate) > REJECTION_HIGH else WARNING, f"{text}."))
    if np.nanmean(rate) < REJECTION_LOW:
        found.append(Verdict(INFO, "Hardly a proposal is rejected: a larger step size would save time."))
    return found
