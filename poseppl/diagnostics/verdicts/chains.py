"""Mixing of Markov chains: divergences, rejection, inefficiency, agreement."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.selection import told
from poseppl.diagnostics.verdicts.verdict import (
    ERROR,
    ESS_LOW,
    INFO,
    WARNING,
    Findings,
    Remedy,
    Verdict,
    not_run,
    settings_among,
    statistic,
    where,
)
from poseppl.runs.contents import names_of
from poseppl.runs.results import is_weighted

TAU_BAD = 25.0
RHAT_HIGH, RHAT_APART = 1.2, 2.0
"""R-hat of chains that disagree, and of chains that are in different places."""
RHAT_SHARE, RHAT_WARNING = 0.02, 0.1
"""Shares of frames and coordinates above `RHAT_HIGH` that are reported, and that are a warning."""
REJECTION_HIGH = 0.4
REJECTION_LOW = 0.01
MAX_NAMED = 4
DIVERGENT, DIVERGENT_ERROR = 0.01, 0.05
"""Shares of all trajectories that diverge, above which their verdict is a warning, an error."""
DIVERGENT_FRAME = 0.1
"""Share of a single frame's trajectories that diverge, above which there is a warning."""


def divergences(tree: xr.DataTree) -> Findings:
    """Divergent trajectories, as a share of all and of those of single frames."""
    counts = statistic(tree, "divergences")
    if counts is None or is_weighted(tree):
        yield not_run()
        return
    if not (counts > 0).any():
        return
    trajectories = _trajectories(tree)
    share, by_frame = float(counts.mean() / trajectories), counts / trajectories
    many = by_frame > DIVERGENT_FRAME
    text = f"{_percent(share)} of trajectories diverge ({counts.sum():.0f})"
    if many.any():
        text += f", more than {_percent(DIVERGENT_FRAME)} in {where(tree, many)}"
    if share <= DIVERGENT and not many.any():
        yield Verdict(INFO, f"{text}: too few to matter.")
    else:
        severity = ERROR if share > DIVERGENT_ERROR else WARNING
        yield Verdict(severity, f"{text}: the step size is too large there;", _smaller_steps(tree))


def _trajectories(tree: xr.DataTree) -> int:
    """Trajectories of a frame: chains times updates by the settings, else the draws that are kept."""
    settings, sizes = told(tree, "settings"), tree["posterior"].sizes
    return int(settings.get("num_chains", sizes["chain"]) * settings.get("num_updates", sizes["draw"]))


def _smaller_steps(tree: xr.DataTree) -> tuple[Remedy, ...]:
    return settings_among(tree, "target_acceptance", lower="step_size")


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def mixing(tree: xr.DataTree) -> Findings:
    """Coordinates with large inefficiency factors, the worst by name, and frames of few effective draws."""
    data = tree["diagnostics"].dataset
    if is_weighted(tree):
        yield not_run()
        return
    tau, ess = np.asarray(data["tau"].values), np.asarray(data["ess"].values)
    names, bad = names_of(tree, "state_dim"), tau > TAU_BAD
    affected = [i for i in np.argsort(-np.where(bad, tau, 0.0).max(axis=0), kind="stable") if bad[:, i].any()]
    for i in affected[:MAX_NAMED]:
        worst = float(tau[bad[:, i], i].max())
        text = f"{names[i]} mixes badly: tau = {worst:.0f} in {where(tree, bad[:, i])}"
        yield Verdict(ERROR if bad[:, i].mean() > 0.5 else WARNING, f"{text}.")
    if len(affected) > MAX_NAMED:
        others = np.array(affected[MAX_NAMED:])
        text = f"{len(others)} other coordinates mix badly (tau up to {tau[:, others][bad[:, others]].max():.0f})"
        yield Verdict(WARNING, f"{text} in {where(tree, bad[:, others].any(axis=1))}.")
    low, more = (ess < ESS_LOW).any(axis=1), settings_among(tree, "num_updates", "num_draws", "num_chains")
    if low.any():
        least = f"{np.nanmin(ess):.1f}, {names[np.nanargmin(np.fmin.reduce(ess))]}"
        text = f"ESS below {ESS_LOW:.0f} in {where(tree, low)} (least {least})"
        yield Verdict(WARNING, f"{text}: means and intervals are imprecise;", more)
    if np.isnan(tau).all():
        more += (Remedy("raise {}", "max_draws"),)
        yield Verdict(WARNING, "Mixing cannot be judged, for there are too few draws per chain;", more)


def agreement(tree: xr.DataTree) -> Findings:
    """Chains that disagree, by R-hat."""
    data = tree["diagnostics"].dataset
    if "rhat" not in data or np.isnan(data["rhat"].values).all():
        yield not_run("" if is_weighted(tree) else "one chain, or few draws")
        return
    rhat = data["rhat"].values
    share, apart = float((rhat > RHAT_HIGH).mean()), float((rhat > RHAT_APART).mean())
    if share <= RHAT_SHARE:
        return
    frame, state_dim = np.unravel_index(int(np.nanargmax(rhat)), rhat.shape)
    worst = f"{rhat[frame, state_dim]:.2f}, {data['state_dim'].values[state_dim]} in frame {data['frame'].values[frame]}"
    text = f"R-hat above {RHAT_HIGH} in {_percent(share)} of frames and coordinates, above {RHAT_APART:g} in {_percent(apart)}"
    severity = WARNING if share > RHAT_WARNING else INFO  # never an error: chains that keep to modes may weigh them well
    more = settings_among(tree, "num_updates", "num_draws", "num_warmup", "num_starts")
    yield Verdict(severity, f"{text} (largest {worst}): the chains disagree;", more)


def rejection(tree: xr.DataTree) -> Findings:
    """Rejection rates that are too high or too low."""
    data = tree["diagnostics"].dataset
    if "rejection_rate" not in data or is_weighted(tree):
        yield not_run()
        return
    rate = data["rejection_rate"].values
    high = rate > REJECTION_HIGH
    if high.any():
        text = f"Rejection rate up to {100 * rate[high].max():.0f} % in {where(tree, high)}: the step size is too large"
        severity = ERROR if np.nanmean(rate) > REJECTION_HIGH else WARNING
        yield Verdict(severity, f"{text};", _smaller_steps(tree))
    if np.nanmean(rate) < REJECTION_LOW:
        yield Verdict(INFO, "Fewer than 1 % of the proposals are rejected: larger steps would save time.")
