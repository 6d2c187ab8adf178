"""Motion that the model itself simulates: what the default tracker makes of it, and goals, for docs/validation/motion.md."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from poseppl_papers.experiment import FAILS, HOLDS
from poseppl_papers.measured import Interval, mean_interval
from poseppl_papers.tables import Table, markdown
from scipy import stats

Tables = Mapping[str, Table]
_DEFAULT, _NEAREST = "default", ("nearly exact", "long chains, 12 Gaussians")
_ERROR, _LOST, _RATE = 45.0, 100.0, 60.0
"""Goals: mean error and that of single sequences at most (mm), frames a second of processor time."""
_INSIDE = {"in_90": (88.0, 92.0), "in_50": (48.0, 52.0)}


def simulated_motion(tables: Tables) -> str:
    """Settings side by side, how they differ on the same sequences, and the goals."""
    rows: dict[str, dict[int, Mapping[str, Any]]] = {}
    for row in tables["simulated_motion"].records():
        rows.setdefault(row["setting"], {})[row["sequence"]] = row
    header = ("", "sequences", "error, mm", f"above {_LOST:.0f} mm", "coverage of 90 % intervals", "50 %", "frames a second")
    lines = [_difference(rows, name) for name in rows if name != _DEFAULT]
    table = markdown(header, [_row(name, own) for name, own in rows.items()])
    lines += _goals(rows[_DEFAULT]) + [_bound(name, rows[name]) for name in _NEAREST if name in rows]
    return f"{table}\n\n" + "\n".join(lines)


def coordinates(tables: Tables) -> str:
    """Which angles of the last frame have intervals that are too narrow, and how wide the posterior itself is."""
    rows: dict[tuple[str, str], dict[int, Mapping[str, Any]]] = {}
    for row in tables["simulated_coordinates"].records():
        rows.setdefault((row["method"], row["part"]), {})[row["sequence"]] = row
    header = ("", "part", "sequences", "coverage of 90 % intervals", "deviation, rad", "error, rad")
    others = [method for method in dict.fromkeys(method for method, _ in rows) if method != _DEFAULT]
    lines = [_beside(rows, method) for method in others]
    return markdown(header, [_angles(*key, own) for key, own in rows.items()]) + "\n\n" + "\n".join(lines)


def _angles(method: str, part: str, rows: Mapping[int, Mapping[str, Any]]) -> list[str]:
    deviation, error = (f"{np.sqrt(np.mean(_values(rows, each) ** 2)):.2f}" for each in ("deviation", "error"))
    return [method, part, str(len(rows)), mean_interval(100 * _values(rows, "inside")).text(".1f") + " %", deviation, error]


def _beside(rows: Mapping[tuple[str, str], Mapping[int, Mapping[str, Any]]], method: str) -> str:
    """The gain of coverage over the default, and the ratio of the default's deviations to its own, by sequence."""
    parts = []
    for part in [part for each, part in rows if each == method]:
        both = rows[_DEFAULT, part], rows[method, part]
        gain = _paired(*both, lambda own, other: 100 * (other["inside"] - own["inside"]))
        ratio = _paired(*both, lambda own, other: own["deviation"] / other["deviation"])
        parts.append(f"{part} {gain.text('.1f')} points, ratio {ratio.text('.2f')}")
    return f"- {method}: gain of coverage over the default, and the default's deviations over its own: {'; '.join(parts)}."


def _paired(own: Mapping[int, Any], other: Mapping[int, Any], compare: Callable[[Any, Any], float]) -> Interval:
    """A mean over the sequences that both have."""
    return mean_interval([compare(own[each], other[each]) for each in sorted(set(own) & set(other))])


def _row(name: str, rows: Mapping[int, Mapping[str, Any]]) -> list[str]:
    error = _values(rows, "error")
    lost = f"{int((error > _LOST).sum())} (largest {error.max():.0f})"
    cover = [mean_interval(100 * _values(rows, each)).text(".1f") + " %" for each in _INSIDE]
    return [name, str(len(rows)), mean_interval(error).text(".1f"), lost, *cover, f"{_per_second(rows):.0f}"]


def _difference(rows: Mapping[str, Mapping[int, Mapping[str, Any]]], name: str) -> str:
    both = sorted(set(rows[name]) & set(rows[_DEFAULT]))
    less = mean_interval([rows[_DEFAULT][each]["error"] - rows[name][each]["error"] for each in both])
    lost = [{each for each in both if rows[kind][each]["error"] > _LOST} for kind in (_DEFAULT, name)]
    only = [len(lost[0] - lost[1]), len(lost[1] - lost[0])]
    chance = float(stats.binomtest(only[0], sum(only)).pvalue) if sum(only) else 1.0
    return (
        f"- {name} in place of the {_DEFAULT}, {len(both)} sequences: errors smaller by {less.text('.1f', ' mm')}, "
        f"{less.above(0)}; above {_LOST:.0f} mm with the {_DEFAULT} alone {only[0]}, with {name} alone {only[1]} "
        f"(sign test, p = {chance:.2g})."
    )


def _goals(rows: Mapping[int, Mapping[str, Any]]) -> list[str]:
    error = mean_interval(_values(rows, "error"))
    lost = int((_values(rows, "error") > _LOST).sum())
    rate, inside = _per_second(rows), {each: mean_interval(100 * _values(rows, each)) for each in _INSIDE}
    covers = [
        f"- Goal: coverage of {each.removeprefix('in_')} % intervals of {low:.0f} to {high:.0f} %: "
        f"{inside[each].within(low, high)} ({inside[each].text('.1f')})."
        for each, (low, high) in _INSIDE.items()
    ]
    return [
        *covers,
        f"- Goal: an error of at most {_ERROR:.0f} mm: {error.below(_ERROR)} ({error.text('.1f')}).",
        f"- Goal: no sequence above {_LOST:.0f} mm: {_verdict(not lost)} ({lost} of {len(rows)}).",
        f"- Goal: {_RATE:.0f} frames a second of processor time: {_verdict(rate >= _RATE)} ({rate:.0f}).",
    ]


def _bound(name: str, rows: Mapping[int, Mapping[str, Any]]) -> str:
    """Best possible result of a filter with the same posterior."""
    error, inside = mean_interval(_values(rows, "error")), mean_interval(100 * _values(rows, "in_90"))
    return (
        f"- The goal of {_ERROR:.0f} mm with the posterior itself, as nearly as {name} has it: {error.below(_ERROR)} "
        f"({error.text('.1f')}, and the coverage of its 90 % intervals is {inside.text('.1f')} %)."
    )


def _values(rows: Mapping[int, Mapping[str, Any]], column: str) -> np.ndarray:
    return np.array([row[column] for row in rows.values()], float)


def _per_second(rows: Mapping[int, Mapping[str, Any]]) -> float:
    return 1 / float(_values(rows, "seconds").mean())


def _verdict(reached: bool) -> str:
    return HOLDS if reached else FAILS
