"""The published claims, and what the tables say of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from poseppl.experiments.experiment import FAILS, HOLDS, UNDECIDED, Claim
from poseppl.experiments.measured import mean_interval
from poseppl.experiments.sminchisescu_triggs.survival import kept_seconds, share_interval
from poseppl.experiments.sminchisescu_triggs.trackers import OURS, PUBLISHED
from poseppl.experiments.tables import Table

Tables = Mapping[str, Table]
LEAST_RUNS = 10
"""Runs below which there is no verdict."""
_FACTOR = 3.0
"""Ratios within this factor of each other count as alike."""
_MORE = 0.1
"""Share of a scene by which more modes and directions may keep the body longer, and the published number still suffices."""
SCENES = {
    "arm": "arm of 8 s",
    "pivot": "pivoting body",
    "complex": "complex motions",
    "pictures": "rendered arm",
}
_APART = "with non-penetration"
_LOSES: Mapping[str, Mapping[str, str]] = {
    "arm": {"Gaussian, single mode": "slips at 0.5 and 2.2 s", "robust, single mode": "at 2.6 s"},
    "pivot": {
        "Gaussian, single mode": "slips at 0.3 s",
        "robust, single mode": "underestimates the turn",
        "MHT, Gaussian, unconstrained": "at 0.5 s",
        "MHT, robust": "at 0.7 s",
    },
    "complex": {
        "Gaussian, single mode": "after 0.5 s",
        "robust, single mode": "after about 1 s",
    },
}
_RATIOS = {"arm": (350.0, "8 coordinates"), "pivot": (2000.0, "body; theirs 32 coordinates, ours 30")}
_SECONDS = {"arm": 5.0, "pivot": 180.0, "complex": 180.0, "pictures": 5.0}


def claims(tables: Tables) -> list[Claim]:
    """The claims that the tables at hand decide."""
    found = [_ratio(tables[scene], *row) for scene, row in _RATIOS.items() if scene in tables]
    for scene, name in SCENES.items():
        if scene not in tables:
            continue
        table = tables[scene]
        for tracker, theirs in _LOSES.get(scene, {}).items():
            if tracker in table.column("tracker"):
                found += [_loses(table, tracker, name, theirs), _sooner(table, tracker, name)]
        if "without joint limits" in table.column("tracker"):
            found.append(_sooner(table, "without joint limits", name))
        if _APART in table.column("tracker"):
            found.append(_sooner(table, PUBLISHED, name, _APART))
        if OURS in table.column("tracker"):
            found.append(_sooner(table, PUBLISHED, name, OURS, theirs="not in the paper"))
        for room in dict.fromkeys(table.column("room")):
            found.append(_keeps(table, name, room))
        if f"{PUBLISHED}, twice as many" in table.column("tracker"):
            found.append(_suffices(table, scene, name))
        found.append(_seconds(table, _SECONDS[scene], name))
    return found


def _first_rate(table: Table, **where: Any) -> dict[str, Any]:
    return {"rate": table.column("rate")[0], **where}


def _judged(runs: int, decided: str) -> str:
    return decided if runs >= LEAST_RUNS else f"no verdict from {runs} runs"


def _share(table: Table, tracker: str, **where: Any) -> tuple[float, float, float, int, float]:
    """Share lost with its interval, runs, and seconds kept."""
    chosen = _first_rate(table, tracker=tracker, **where)
    lost, length = table.column("lost", **chosen), table.column("length", **chosen)
    count = int(np.isfinite(lost).sum())
    return count / len(lost), *share_interval(count, len(lost)), len(lost), float(kept_seconds(lost, length).mean())


def _loses(table: Table, tracker: str, name: str, theirs: str) -> Claim:
    share, low, high, runs, kept = _share(table, tracker)
    verdict = HOLDS if low > 0.5 else FAILS if high < 0.5 else UNDECIDED
    ours = f"lost in {100 * share:.0f} % ({100 * low:.0f} to {100 * high:.0f}) of {runs} runs, kept for {kept:.2f} s"
    return Claim(f"{name}: lost by {tracker}", theirs, ours, _judged(runs, verdict), "more than half of the runs, or fewer")


def _keeps(table: Table, name: str, room: str) -> Claim:
    share, low, high, runs, kept = _share(table, PUBLISHED, room=room)
    verdict = HOLDS if high < 0.5 else FAILS if low > 0.5 else UNDECIDED
    ours = f"lost in {100 * share:.0f} % ({100 * low:.0f} to {100 * high:.0f}) of {runs} runs, kept for {kept:.2f} s"
    what = f"{name}, {room} room: kept to the end by {PUBLISHED} sampling"
    return Claim(what, "kept", ours, _judged(runs, verdict), "fewer than half of the runs lose it, or more")


def _difference(table: Table, one: str, other: str) -> tuple[float, float, float, int]:
    """Seconds that one tracker keeps the body longer than another on the same data, with the interval, and runs."""
    kept = []
    for tracker in (one, other):
        rows = table.records(**_first_rate(table, tracker=tracker))
        kept.append({(row["motion"], row["room"], row["seed"]): min(row["lost"], row["length"]) for row in rows})
    both = [key for key in kept[0] if key in kept[1]]
    return *mean_interval(np.array([kept[0][key] - kept[1][key] for key in both])), len(both)


def _sooner(table: Table, tracker: str, name: str, other: str = PUBLISHED, theirs: str = "longer") -> Claim:
    mean, low, high, runs = _difference(table, other, tracker)
    verdict = HOLDS if low > 0 else FAILS if high < 0 else UNDECIDED
    ours = f"{mean:.2f} s longer ({low:.2f} to {high:.2f}), {runs} pairs of runs"
    kind = other if other == OURS else f"{other} sampling"
    what = f"{name}: {kind} keeps the body longer than {tracker}"
    return Claim(what, theirs, ours, _judged(runs, verdict), "mean difference on the same points, 95 % interval")


def _suffices(table: Table, scene: str, name: str) -> Claim:
    mean, low, high, runs = _difference(table, f"{PUBLISHED}, twice as many", PUBLISHED)
    limit = _MORE * float(table.column("length")[0])
    verdict = HOLDS if high < limit else FAILS if low > limit else UNDECIDED
    numbers = "3 modes x 3 directions" if scene == "arm" else "7 modes x 6 directions"
    ours = f"twice as many of both: {mean:.2f} s longer ({low:.2f} to {high:.2f}), {runs} pairs of runs"
    why = f"less than {limit:.2g} s, a tenth of the scene"
    return Claim(f"{name}: {numbers} suffice", "the whole sequence", ours, _judged(runs, verdict), why)


def _ratio(table: Table, published: float, what: str) -> Claim:
    logs = np.log(table.column("ratio", **_first_rate(table, tracker=PUBLISHED)))
    mean, low, high = (float(np.exp(each)) for each in mean_interval(logs))
    inside = published / _FACTOR < low and high < published * _FACTOR
    outside = high < published / _FACTOR or low > published * _FACTOR
    verdict = HOLDS if inside else FAILS if outside else UNDECIDED
    ours = f"{mean:,.0f} ({low:,.0f} to {high:,.0f}), {len(logs)} runs"
    why = f"within a factor of {_FACTOR:g}; metres and radians, with the prior over time"
    claim = f"Largest over smallest standard deviation of a mode, {what}"
    return Claim(claim, f"{published:,.0f}", ours, _judged(len(logs), verdict), why)


def _seconds(table: Table, published: float, name: str) -> Claim:
    seconds = table.column("seconds", **_first_rate(table, tracker=PUBLISHED))
    mean, low, high = mean_interval(seconds)
    ours = f"{mean:.2g} s of a processor ({max(low, 0):.2g} to {high:.2g}), {len(seconds)} runs"
    why = "another machine than their SGI O2 of 270 MHz; points stand in for images where frames are not rendered"
    return Claim(f"{name}: seconds a frame", f"{published:g} s", ours, "measured, without a verdict", why)
