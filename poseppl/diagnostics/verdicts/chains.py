"""Mixing of Markov chains: divergences, agreement, inefficiency, rejection; thresholds and gains of `efficiency`."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.efficiency import (
    ESS_AMPLE,
    ESS_GOOD,
    ESS_LOW,
    GAIN_HIGH,
    RHAT_APART,
    RHAT_HIGH,
    RHAT_SHARE,
    RHAT_WARNING,
    TAU_BAD,
    best_acceptance,
    disagreement,
    gain_of_longer_trajectories,
    gain_of_step_size,
    moves_of,
)
from poseppl.diagnostics.verdicts.verdict import (
    ERROR,
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
from poseppl.runs.contents import names_of, variable
from poseppl.runs.results import is_weighted

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
    trajectories = moves_of(tree).number
    share, many = float(counts.mean() / trajectories), counts / trajectories > DIVERGENT_FRAME
    text = f"{_percent(share)} of trajectories diverge ({counts.sum():.0f})"
    if many.any():
        text += f", more than {_percent(DIVERGENT_FRAME)} in {where(tree, many)}"
    if share <= DIVERGENT and not many.any():
        yield Verdict(INFO, f"{text}: too few to matter.")
    else:
        severity = ERROR if share > DIVERGENT_ERROR else WARNING
        yield Verdict(severity, f"{text}: the step size is too large there;", _smaller_steps(tree))


def _smaller_steps(tree: xr.DataTree) -> tuple[Remedy, ...]:
    return settings_among(tree, "target_acceptance", lower=("step_size",))


def _percent(share: float) -> str:
    return f"{float(f'{100 * share:.2g}'):g} %"


def agreement(tree: xr.DataTree) -> Findings:
    """Chains that disagree, by R-hat."""
    rhat = variable(tree, "diagnostics", "rhat")
    if rhat is None or np.isnan(rhat).all():
        yield not_run("" if is_weighted(tree) else "one chain, or few draws")
        return
    share, apart = disagreement(rhat), float((rhat > RHAT_APART).mean())
    if share <= RHAT_SHARE:
        return
    data = tree["diagnostics"].dataset
    frame, state_dim = np.unravel_index(int(np.nanargmax(rhat)), rhat.shape)
    worst = f"{rhat[frame, state_dim]:.2f}, {data['state_dim'].values[state_dim]} in frame {data['frame'].values[frame]}"
    text = f"R-hat above {RHAT_HIGH} in {_percent(share)} of frames and coordinates, above {RHAT_APART:g} in {_percent(apart)}"
    severity = WARNING if share > RHAT_WARNING else INFO  # never an error: chains that keep to modes may weigh them well
    more = settings_among(tree, "num_updates", "num_draws", "num_warmup", "num_starts")
    yield Verdict(severity, f"{text} (largest {worst}): the chains disagree, and tau says little there;", more)


def mixing(tree: xr.DataTree) -> Findings:
    """Coordinates with large inefficiency factors, the worst by name; frames of few effective draws, and draws to spare."""
    if is_weighted(tree):
        yield not_run()
        return
    tau, ess = (np.asarray(tree["diagnostics"].dataset[name].values) for name in ("tau", "ess"))
    yield from _large_factors(tree, tau)
    low, more = (ess < ESS_LOW).any(axis=1), settings_among(tree, "num_updates", "num_draws", "num_chains")
    if low.any():
        least, name = np.nanmin(ess), names_of(tree, "state_dim")[np.nanargmin(np.fmin.reduce(ess))]
        text = f"ESS below {ESS_LOW:.0f} in {where(tree, low)} (least {least:.1f}, {name}): means and intervals are imprecise"
        yield Verdict(WARNING, f"{text}; for an ESS of {ESS_GOOD:.0f}, draw {ESS_GOOD / least:.0f} times as much:", more)
    if np.isnan(tau).all():
        more += (Remedy("raise {}", "max_draws"),)
        yield Verdict(WARNING, "Mixing cannot be judged, for there are too few draws per chain;", more)
    elif np.nanmin(ess) >= ESS_AMPLE and disagreement(tree["diagnostics"].dataset.get("rhat", np.nan)) == 0:
        text = f"Every ESS is above {ESS_AMPLE:.0f}, but one of {ESS_GOOD:.0f} gives means to a tenth of the posterior SD"
        fewer = settings_among(tree, lower=("num_updates", "num_draws"))
        yield Verdict(INFO, f"{text}, {np.nanmin(ess) / ESS_GOOD:.0f} times as fast. To save time,", fewer)


def _large_factors(tree: xr.DataTree, tau: np.ndarray) -> Findings:
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
    longer = settings_among(tree, "num_leapfrog") if moves_of(tree).kind == "HMC" else ()
    if affected and longer:
        gain = gain_of_longer_trajectories(float(np.median(tau[bad])))
        text = f"Trajectories twice as long give about {gain:.1f} times the ESS per gradient where tau is above {TAU_BAD:.0f}:"
        yield Verdict(INFO, text, longer)


def rejection(tree: xr.DataTree) -> Findings:
    """Step sizes that are too large in some frames, or too small on average, and the gain of the best one."""
    rate, data = variable(tree, "diagnostics", "rejection_rate"), tree["diagnostics"].dataset
    if rate is None or is_weighted(tree):
        yield not_run()
        return
    moves, tau = moves_of(tree), np.fmax.reduce(data["tau"].values, axis=1)
    best = best_acceptance(moves.kind)
    gain = np.minimum(gain_of_step_size(1 - rate, moves.kind), tau * max(moves.gradients, 1.0))
    gain = np.nan_to_num(gain, nan=1.0)  # nothing is claimed where tau is unknown
    high = (1 - rate < best) & (gain > GAIN_HIGH)
    if high.any():
        text = f"Rejection rate up to {_percent(rate[high].max())} in {where(tree, high)}: the step size is too large"
        yield Verdict(WARNING, f"{text}; {_gained(np.median(gain[high]), moves.kind)}", _smaller_steps(tree))
    small = np.median(np.where(1 - rate > best, gain, 1.0))
    if small > GAIN_HIGH:
        text = f"Only {_percent(float(np.nanmean(rate)))} of the proposals are rejected: the step size is too small"
        larger = settings_among(tree, "step_size", lower=("target_acceptance",))
        yield Verdict(INFO, f"{text}; {_gained(small, moves.kind)}", larger)


def _gained(gain: float, kind: str) -> str:
    rate = 100 * (1 - best_acceptance(kind))
    return f"at {rate:.0f} % ({kind}) there would be about {gain:.1f} times the ESS per evaluation:"
