"""The page: each published claim, theirs and ours, whether it holds, and why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from poseppl.experiments.choo_fleet.goals import Goal, goals
from poseppl.experiments.tables import Table, markdown

Tables = Mapping[str, Table]
_NAMES = {"arm": "4-D arm", "lower_body": "10-D lower body", "full_body": "28-D full body"}


class Claim(NamedTuple):
    """A published claim.

    Attributes:
        what: The claim.
        theirs: Their figure.
        ours: Ours, with its error.
        verdict: "holds", "does not hold", or "undecided".
        why: In a sentence.
    """

    what: str
    theirs: str
    ours: str
    verdict: str
    why: str


def claims(tables: Tables) -> list[Claim]:
    """All claims that the tables at hand decide."""
    found: list[Claim] = []
    if "speed_ups" in tables:
        found += [_speed_up(row) for row in tables["speed_ups"].select(by="seconds")]
        found += [_bound(row) for row in tables["volumes"].select(volume="marginal")]
    if "sequence" in tables:
        for tracker in dict.fromkeys(tables["sequence"].column("tracker")):
            methods = list(dict.fromkeys(tables["sequence"].column("method", tracker=tracker)))
            rivals = [method for method in methods if method.startswith("particle filter")]
            found += [_higher(tables["sequence"], tracker, rival, name) for name in _FIGURES for rival in rivals]
    if "tuning" in tables:
        numbers = list(dict.fromkeys(tables["tuning"].column("leapfrog")))
        found += [_rejection(tables["tuning"], None)]
        found += [_rejection(tables["tuning"], number) for number in numbers if number == PUBLISHED_LEAPFROG]
    return found


_FIGURES = {"log_likelihood": "log-likelihood of the mean state (Fig. 4)", "log_prior": "log prior of the true state (Fig. 5)"}


def _speed_up(row: tuple[Any, ...]) -> Claim:
    tracker, _, ratio, low, high, outside, published = row
    faster = published > 1
    theirs = _faster(published)
    ends = (low, high) if ratio > 1 else (high, low)
    ours = f"{_faster(ratio)} ({' to '.join(map(_times, ends))})"
    if low <= 1 <= high:
        verdict, why = "undecided", "the interval holds 1"
    elif (ratio > 1) != faster:
        verdict, why = "does not hold", "the other filter is the faster one"
    elif 1 / 3 < ratio / published < 3:
        verdict, why = "holds", "within a factor of three"
    else:
        side = "larger" if (ratio > published) == faster else "smaller"
        verdict, why = "holds in direction", f"the advantage is {side} than published"
    if outside:
        why += f"; {outside:.0%} of the settings extrapolate the particle filter as 1/N, which flatters it"
    return Claim(f"Time at equal variance, {_NAMES[tracker]} (Figs. 2, 3)", theirs, ours, verdict, why)


def _faster(ratio: float) -> str:
    """Who is faster, and how many times."""
    return f"{'HMC' if ratio > 1 else 'particle filter'} {_times(ratio)} times faster"


def _times(ratio: float) -> str:
    times = max(ratio, 1 / ratio)
    return f"{times:,.0f}" if times >= 10 else f"{times:.1f}"


def _bound(row: tuple[Any, ...]) -> Claim:
    tracker, _, value, low, high, published = row
    holds = abs(value - published) <= 1
    why = (
        "within a power of ten"
        if holds
        else "our posterior is wider against its prior"
        if value < published
        else "ours is narrower"
    )
    ours = f"10^{value:.1f} (frames from {low:.1f} to {high:.1f})"
    verdict = "holds" if holds else "does not hold"
    return Claim(f"Least particles, {_NAMES[tracker]} (section 7.3)", f"10^{published:.0f}", ours, verdict, why)


def _higher(table: Table, tracker: str, rival: str, name: str) -> Claim:
    (hmc, hmc_error), (particle, particle_error) = (
        [table.column(each, tracker=tracker, method=method)[1:] for each in (name, f"{name}_standard_error")]
        for method in ("HMC filter", rival)
    )
    difference = hmc - particle
    error = np.sqrt(hmc_error**2 + particle_error**2)
    above, below = (float(np.mean(sign * difference > 2 * error)) for sign in (1, -1))
    verdict = "holds" if above >= 0.8 else "holds in part" if above > max(0.2, below) else "does not hold"
    shares = f"higher in {above:.0%}, lower in {below:.0%} of the frames"
    ours = f"mean difference {difference.mean():.3g}; by two standard errors {shares}"
    why = "at equal time" if rival.endswith("equal time") else "at the published R and N"
    if max(above, below) <= 0.2:
        why += ", both filters do as well"
    return Claim(f"{_FIGURES[name]}, {_NAMES[tracker]}", "HMC higher", ours, verdict, why)


def _rejection(table: Table, leapfrog: int | None) -> Claim:
    """The rule of 15 %: over all L, or at one."""
    rows = [row for row in table.rows if np.isfinite(row[5]) and leapfrog in (None, row[0])]
    best = min(rows, key=lambda row: row[5])
    near = 0.1 <= best[2] <= 0.25
    ours = f"cheapest at {best[2]:.0%} (L = {best[0]}, step size {best[1]:g}, {best[5]:.3g} gradients a draw)"
    within = [row[2] for row in rows if row[0] == best[0] and row[5] <= 1.25 * best[5]]
    why = f"from {min(within):.0%} to {max(within):.0%} the cost stays within a quarter of the least"
    where = "any L" if leapfrog is None else f"the published L = {leapfrog}"
    return Claim(f"Best step size rejects about 15 % (section 7.5), {where}", "15 %", ours, _HOLDS[near], why)


_HOLDS = {True: "holds", False: "does not hold"}
PUBLISHED_LEAPFROG = 40
"""L of the full body in Table 1."""


def write_page(tables: Tables, pictures: Mapping[str, str], notes: list[str]) -> str:
    """The page as Markdown.

    Args:
        tables: By name.
        pictures: Titles of the figures by their file names.
        notes: What was run.
    """
    found = claims(tables)
    rows = [(claim.what, claim.theirs, claim.ours, claim.verdict, claim.why) for claim in found]
    parts = ["# Choo and Fleet 2001, run again", *notes]
    if rows:
        parts += ["## Claims", markdown(("claim", "theirs", "ours", "verdict", "why"), rows)]
    reached = goals(tables)
    if reached:
        parts += ["## Goals", markdown(Goal._fields, reached)]
    for file, title in pictures.items():
        parts += [f"## {title}", f"![{title}]({file})"]
    for name in _SHOWN:
        if name in tables:
            table = tables[name]
            parts += [f"## {name.replace('_', ' ').capitalize()}", table.about, markdown(table.columns, table.rows)]
    return "\n\n".join(parts) + "\n"


_SHOWN = ("speed_ups", "volumes", "references", "sequence_summary", "contest", "contest_sequences")
