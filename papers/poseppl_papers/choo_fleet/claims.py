"""The published claims, theirs and ours, and the library's own goals: whether each holds, and which numbers say so."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from poseppl_papers.choo_fleet.plan import PUBLISHED_UPDATES
from poseppl_papers.experiment import (
    FAILS,
    HOLDS,
    UNDECIDED,
    UNPUBLISHED,
    Claim,
    Tables,
    claims_by_table,
    on_one_recording,
    verdict_of,
)
from poseppl_papers.measured import MATTERS, Interval
from poseppl_papers.tables import Table

_NAMES = {"arm": "4-D arm", "lower_body": "10-D lower body", "full_body": "28-D full body"}
FREE_MARKERS = {"arm": 2 / 17, "lower_body": 6 / 17, "full_body": 1.0}
"""Share of the markers that the free coordinates move; the others, whose intervals have no width, are never inside of them."""
_RULE = 0.15
_QUARTER = 1.25
_BURN_IN, _LAST = 6, 10
"""Burn-in of section 7.2, and how many of the longest ones show the level at which R-hat settles."""
PUBLISHED_LEAPFROG = 40
"""L of the full body in Table 1."""


_FIGURES = {"log_likelihood": "log-likelihood of the mean state (Fig. 4)", "log_prior": "log prior of the true state (Fig. 5)"}
_READINGS = {
    1: ("standard deviations", "the volumes within one standard deviation, as Eq. 7 has them"),
    2: ("variances", "the marginal variances, which sections 3 and 7.3 name; the square of the other reading"),
}


def _speed_ups(tables: Tables) -> list[Claim]:
    return [_speed_up(row) for row in tables["speed_ups"].select(by="seconds")]


def _bounds(tables: Tables) -> list[Claim]:
    return [_bound(row, power) for power in _READINGS for row in tables["volumes"].select(volume="marginal")]


def _over_time(tables: Tables) -> Iterator[Claim]:
    for tracker in tables["sequence"].values("tracker"):
        methods = tables["sequence"].values("method", tracker=tracker)
        rivals = [method for method in methods if method.startswith("particle filter")]
        yield from (_higher(tables, tracker, rival, name) for name in _FIGURES for rival in rivals)


def _rejections(tables: Tables) -> list[Claim]:
    published = [number for number in tables["tuning"].values("leapfrog") if number == PUBLISHED_LEAPFROG]
    return [_rejection(tables["tuning"], number) for number in (None, *published)]


def _speed_up(row: tuple[Any, ...]) -> Claim:
    tracker, _, ratio, low, high, outside, published = row
    faster = published > 1
    theirs = _faster(published)
    ends = (low, high) if ratio > 1 else (high, low)
    ours = f"{_faster(ratio)} ({' to '.join(map(_times, ends))})"
    if low <= 1 <= high:
        verdict, why = UNDECIDED, "the interval holds 1"
    elif (ratio > 1) != faster:
        verdict, why = FAILS, "the other filter is the faster one"
    elif 1 / 3 < ratio / published < 3:
        verdict, why = HOLDS, "within a factor of three"
    else:
        side = "larger" if (ratio > published) == faster else "smaller"
        verdict, why = "holds in direction", f"the advantage is {side} than published"
    if outside:
        why += f"; {outside:.0%} of the settings extrapolate the particle filter as 1/N, which flatters it"
    return Claim(f"Time at equal variance, {_NAMES[tracker]} (Figs. 2, 3)", theirs, ours, verdict, why)


def _faster(ratio: float) -> str:
    """The faster filter, and by which factor."""
    return f"{'HMC' if ratio > 1 else 'particle filter'} {_times(ratio)} times faster"


def _times(ratio: float) -> str:
    times = max(ratio, 1 / ratio)
    return f"{times:,.0f}" if times >= 10 else f"{times:.1f}"


def _bound(row: tuple[Any, ...], power: int) -> Claim:
    """The bound on N from the ratios of standard deviations (power 1), or from those of variances (power 2)."""
    tracker, _, *exponents, published = row
    value, low, high = (power * exponent for exponent in exponents)
    name, why = _READINGS[power]
    holds = abs(value - published) <= 1
    distance = (
        "within a power of ten"
        if holds
        else f"10^{abs(value - published):.1f} times {'fewer' if value < published else 'more'}"
    )
    ours = f"10^{value:.1f} (frames from {low:.1f} to {high:.1f})"
    if tracker == "full_body":
        distance += "; theirs is an extrapolation"
    what = f"Least particles, {_NAMES[tracker]} (section 7.3), from {name}"
    return Claim(what, f"10^{published:.0f}", ours, verdict_of(holds), f"{distance}; {why}")


def _higher(tables: Tables, tracker: str, rival: str, name: str) -> Claim:
    table = tables["sequence"]
    (hmc, hmc_error), (particle, particle_error) = (
        [table.column(each, tracker=tracker, method=method)[1:] for each in (name, f"{name}_standard_error")]
        for method in ("HMC filter", rival)
    )
    difference = hmc - particle
    error = np.sqrt(hmc_error**2 + particle_error**2)
    above, below = (float(np.mean(sign * difference > 2 * error)) for sign in (1, -1))
    verdict = HOLDS if above >= 0.8 else "holds in part" if above > max(0.2, below) else FAILS
    shares = f"higher in {above:.0%}, lower in {below:.0%} of the frames"
    ours = f"mean difference {difference.mean():.3g}; by two standard errors {shares}"
    why = f"against the {rival}{_time_of(tables, tracker, rival)}"
    if max(above, below) <= 0.2:
        why += "; both filters do as well"
    return Claim(f"{_FIGURES[name]}, {_NAMES[tracker]}", "HMC higher", ours, verdict, why)


def _time_of(tables: Tables, tracker: str, rival: str) -> str:
    """How long the rival took, in units of the HMC filter's time: in the same runs, and timed alone at one frame."""
    times = []
    if "sequence_summary" in tables:
        summary = tables["sequence_summary"]
        rate = [summary.column("frames_per_second", tracker=tracker, method=each)[0] for each in ("HMC filter", rival)]
        times.append(f"{rate[0] / rate[1]:.1f} times as long")
        if "variances" in tables and tables["variances"].select(tracker=tracker, method="hmc", size=PUBLISHED_UPDATES):
            number = summary.column("evaluations_per_frame", tracker=tracker, method=rival)[0]
            times.append(f"{_alone(tables['variances'], tracker, number):.1f} times when timed alone at one frame")
    return f", which took {', '.join(times)}" if times else ""


def _alone(table: Table, tracker: str, num_particles: float) -> float:
    """Seconds of N particles over those of HMC with the R of sequences, from the single frames."""
    size, seconds = (table.column(name, tracker=tracker, method="particle") for name in ("size", "seconds"))
    order = np.argsort(size)
    spent = np.exp(np.interp(np.log(num_particles), np.log(size[order]), np.log(seconds[order])))
    return float(spent / table.column("seconds", tracker=tracker, method="hmc", size=PUBLISHED_UPDATES)[0])


def _burn_ins(tables: Tables) -> list[Claim]:
    """Whether six updates are burn-in enough at the published L, at the step size that rejects most nearly 15 %."""
    tuning = tables["tuning"].records(leapfrog=PUBLISHED_LEAPFROG) if "tuning" in tables else []
    if not tuning:
        return []
    best = min(tuning, key=lambda row: abs(row["rejection"] - _RULE))
    where = {"leapfrog": PUBLISHED_LEAPFROG, "step_size": best["step_size"]}
    rhat = tables["burn_in"].column("rhat", **where)[np.argsort(tables["burn_in"].column("burn_in", **where))]
    after, level = float(rhat[_BURN_IN]), float(np.median(rhat[-_LAST:]))
    ours = f"R-hat {after:.2f} after {_BURN_IN}, {level:.2f} after many ({best['rejection']:.0%} rejected)"
    why = "R-hat less 1 is at most a tenth above its last level; largest over coordinates, of 16 updates, median over runs"
    verdict = verdict_of(after - 1 <= (1 + MATTERS) * (level - 1))
    return [Claim("Six burn-in samples of each chain suffice (section 7.2), 28-D full body, L = 40", "6", ours, verdict, why)]


def _covered(tables: Tables) -> list[Claim]:
    """Coverage of 90 % intervals of the state's coordinates, and of the places of the markers that they move."""
    found = []
    for row in tables["sequence_summary"].records():
        moved = row["markers_in_90"] / FREE_MARKERS[row["tracker"]]
        ours = f"{100 * row['state_in_90']:.0f} % of the coordinates, {100 * moved:.0f} % of the markers' places that they move"
        why = "85 to 95 % are expected; the places of clamped markers are known, and do not count"
        what = f"Coverage of 90 % intervals, {_NAMES[row['tracker']]}, {row['method']}"
        verdict = on_one_recording(verdict_of(0.85 <= row["state_in_90"] <= 0.95))
        found.append(Claim(what, UNPUBLISHED, ours, verdict, why))
    return found


def _rejection(table: Table, leapfrog: int | None) -> Claim:
    """The rule of 15 %: at the cheapest L of all, or at one; it holds where 15 % cost at most a quarter more than the least.

    The interval has two standard errors, over runs.
    """
    rows = [row for row in table.rows if np.isfinite(row[5]) and leapfrog in (None, row[0])]
    best = min(rows, key=lambda row: row[5])
    curve = sorted((row for row in rows if row[0] == best[0]), key=lambda row: row[2])
    rejection, cost, error = np.transpose([(row[2], np.log(row[5]), row[6]) for row in curve])
    weights = [np.interp(_RULE, rejection, unit) for unit in np.eye(len(curve))] - (cost == cost.min())
    more, reach = weights @ cost, 2 * np.linalg.norm(weights * error)
    ratio = Interval(*map(float, np.exp([more, more - reach, more + reach])))
    ours = f"cheapest at {best[2]:.1%} (L = {best[0]}, step size {best[1]:g}, {best[5]:.3g} gradients a draw)"
    why = f"at 15 % a draw costs {ratio.text('.1f')} times as much"
    where = "the cheapest L" if leapfrog is None else f"the published L = {leapfrog}"
    return Claim(f"Best step size rejects about 15 % (section 7.5), {where}", "15 %", ours, ratio.below(_QUARTER), why)


claims = claims_by_table(
    {
        "speed_ups": [_speed_ups],
        "volumes": [_bounds],
        "sequence": [_over_time],
        "tuning": [_rejections],
        "burn_in": [_burn_ins],
        "sequence_summary": [_covered],
    }
)


PUBLISHED = "HMC, as published"
RATIO, RATE = 10.0, 60.0
BANDS = {"markers_in_90": (0.87, 0.93), "markers_in_50": (0.46, 0.54)}
_SMALL = 0.1
"""Bias, in posterior standard deviations, above which an estimate is not counted as one of the posterior's mean."""


class Goal(NamedTuple):
    """A goal.

    Attributes:
        what: The goal.
        ours: Result.
        verdict: "reached" or "not reached".
    """

    what: str
    ours: str
    verdict: str


def goals(tables: Tables) -> list[Goal]:
    """The goals that the tables at hand decide."""
    found: list[Goal] = []
    if "contest" in tables and tables["contest"].select(method=PUBLISHED):
        found += [_fewer_seconds(tables), _fewer_evaluations(tables["contest"])]
    if "contest_sequences" in tables:
        table = tables["contest_sequences"]
        found += [_calibrated(table, recording) for recording in table.values("recording")]
    return found


def _fewer_seconds(tables: Tables) -> Goal:
    """Judged by the shorter of the times of the published settings: in the contest, and alone at single frames."""
    ratio, best, theirs = _ratio(tables["contest"], "second")
    ours = f"{ratio:.3g} times fewer"
    if "variances" in tables:
        alone = tables["variances"].column("seconds", tracker="full_body", method="hmc", size=PUBLISHED_UPDATES)
        if len(alone):
            other = ratio * float(alone[0]) / theirs["seconds"]
            ours = f"{ours} than theirs in the contest, {other:.3g} times fewer than theirs alone (variances.csv)"
            ratio = min(ratio, other)
    return _goal("seconds", best, ours, ratio)


def _fewer_evaluations(table: Table) -> Goal:
    ratio, best, _ = _ratio(table, "evaluation")
    return _goal("evaluations", best, f"{ratio:.3g} times fewer", ratio)


def _ratio(table: Table, by: str) -> tuple[float, dict[str, Any], dict[str, Any]]:
    """How many times more effective draws the best unbiased method has than the published settings, and both rows."""
    rows, name = table.records(), f"effective_draws_per_{by}"
    theirs = next(row for row in rows if row["method"] == PUBLISHED)
    best = max((row for row in rows if row["bias"] < _SMALL), key=lambda row: row[name])
    return best[name] / theirs[name], best, theirs


def _goal(what: str, best: Mapping[str, Any], ours: str, ratio: float) -> Goal:
    measured = f"{best['method']}: {ours}; bias {best['bias']:.2g} standard deviations"
    goal = f"{RATIO:.0f} times fewer {what} than the paper's settings at equal error of one frame's mean"
    return Goal(goal, measured, "reached" if ratio >= RATIO else "not reached")


def _calibrated(table: Table, recording: str) -> Goal:
    rows = table.records(recording=recording)
    calibrated = [row for row in rows if all(low <= row[name] <= high for name, (low, high) in BANDS.items())]
    what = f"{RATE:.0f} frames a second, 90 % intervals covering 87 to 93 % and 50 % ones 46 to 54 %: {recording}"
    if not calibrated:
        nearest = min(rows, key=lambda row: abs(row["markers_in_90"] - 0.9) + abs(row["markers_in_50"] - 0.5))
        return Goal(what, f"no method is calibrated; the nearest is {_told(nearest)}", "not reached")
    best = max(calibrated, key=lambda row: row["frames_per_second"])
    return Goal(what, _told(best), "reached" if best["frames_per_second"] >= RATE else "not reached")


def _told(row: Mapping[str, Any]) -> str:
    cover = f"{100 * row['markers_in_90']:.1f} and {100 * row['markers_in_50']:.1f} %"
    return f"{row['method']}, {cover}, {row['error']:.0f} mm, {row['frames_per_second']:.0f} frames a second on one core"
