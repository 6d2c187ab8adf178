"""Recorded walks as a detector's keypoints, and ranks of the smoother's truth, for docs/validation/keypoints.md."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import mean, median
from typing import Any

from poseppl_papers.measured import mean_interval
from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
Rows = Sequence[Mapping[str, Any]]
ANGLE, HELD, ECE = 2.0, (0.85, 0.95), 0.05
"""The goals: degrees in the median, shares of 90 % intervals, mean distance of coverage from its level."""
TOLD = 12.0
"""Keypoints determine an angle if its ideal precision is below this, degrees."""
WRONG = 30.0
"""An angle that is off by more degrees than this in half of the frames is another one, such as of a joint bent backwards."""
CHANCE = 0.01
"""Ranks of a smaller chance are not uniform."""
PLACES, SHOWN = "places", "no clutter"
BINS = tuple(f"bin_{k}" for k in range(10))
SHARES = ("coverage_50", "coverage_90")
RIGHT = ("right", "corrected")


def recorded(tables: Tables) -> str:
    """Errors and coverage of joints and angles by errors and cameras, of limbs, of each angle, and the goals."""
    records, limbs = tables["simulated_keypoints"].records(), tables["simulated_limbs"].records()
    informed, untold = _told(records)
    cases = list(dict.fromkeys((row["case"], row["cameras"]) for row in limbs))
    columns = ("errors of the points", "cameras", "recordings", "joints, mm", "95 %", "aligned, mm", "in 50 %", "in 90 %")
    columns = (*columns, "angles, degrees", "95 %", "in 50 %", "in 90 %", "swapped limbs", "found", "false alarms")
    cells, said = [], []
    for case, cameras in cases:
        own = [row for row in records if (row["case"], row["cameras"]) == (case, cameras)]
        seen = [row for row in limbs if (row["case"], row["cameras"]) == (case, cameras)]
        joints, angles = ([row for row in own if row["what"] in what] for what in ({PLACES}, informed))
        error, held = _by_recording(angles, "median", median), _by_recording(angles, "coverage_90", mean)
        near = _interval([row["aligned"] for row in seen], 0)
        cells.append([case, str(cameras), str(len(seen)), *_cells(joints, 0, near), *_cells(angles, 1), *_limbs(seen)])
        said.append(
            f"- {case}, {cameras} cameras: within {ANGLE:g} degrees in the median {_below(error, ANGLE)}; 85 to 95 % in 90 % "
            f"intervals of the joints {_inside(_by_recording(joints, 'coverage_90', mean))}, of the angles {_inside(held)}."
        )
    wrong = [
        f"{row['what']} of {row['recording']} ({row['cameras']} cameras)"
        for row in records
        if row["case"] == SHOWN and row["what"] in informed and row["median"] > WRONG
    ]
    said.append(f"- More than {WRONG:g} degrees off in the median, {SHOWN}: {', '.join(wrong) or 'none'}.")
    last = f"Ideal SD above {TOLD:g} degrees, and left out of the angles above: {', '.join(untold)}."
    return "\n\n".join([markdown(columns, cells), "\n".join(said), _angle_table(records), last])


def _told(records: Rows) -> tuple[set[str], list[str]]:
    """Angles that the keypoints tell, and those that they do not; one that cannot move is neither."""
    ideal: dict[str, list[float]] = {}
    for row in records:
        if row["what"] != PLACES:
            ideal.setdefault(row["what"], []).append(row["ideal"])
    means = {name: mean(values) for name, values in ideal.items()}
    return {name for name, value in means.items() if 0.01 < value <= TOLD}, [n for n, value in means.items() if value > TOLD]


def _by_recording(rows: Rows, column: str, average: Any) -> list[float]:
    """The average over angles of each recording."""
    names = dict.fromkeys(row["recording"] for row in rows)
    return [float(average([row[column] for row in rows if row["recording"] == name])) for name in names]


def _interval(values: Sequence[float], digits: int) -> str:
    average, low, high = mean_interval(values)
    return f"{average:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _cells(rows: Rows, digits: int, *more: str) -> list[str]:
    """Median with its interval over recordings, 95th percentile, more, and coverage in percent."""
    worst = f"{mean(_by_recording(rows, 'percentile_95', median)):.{digits}f}"
    shares = [_interval([100 * share for share in _by_recording(rows, name, mean)], 0) for name in SHARES]
    return [_interval(_by_recording(rows, "median", median), digits), worst, *more, *shares]


def _limbs(rows: Rows) -> list[str]:
    found = {name: sum(row[name] for row in rows) for name in ("exchanged", "found", "falsely", "pairs")}
    return [f"{found['exchanged']} of {found['pairs']}", str(found["found"]), str(found["falsely"])]


def _angle_table(records: Rows) -> str:
    """Each angle, means over recordings, where nothing is clutter."""
    rows = [row for row in records if row["case"] == SHOWN and row["what"] != PLACES]
    cameras = list(dict.fromkeys(row["cameras"] for row in rows))
    cells = []
    for name in dict.fromkeys(row["what"] for row in rows if row["ideal"] > 0.01):
        of = {count: [row for row in rows if (row["what"], row["cameras"]) == (name, count)] for count in cameras}
        each = [[mean(row[key] for row in of[count]) for key in ("median", *SHARES, "width")] for count in cameras]
        ideal = mean(row["ideal"] for row in of[cameras[0]])
        parts = [part for e, half, most, w in each for part in (f"{e:.1f}", f"{100 * half:.0f}, {100 * most:.0f}", f"{w:.0f}")]
        cells.append([name, f"{ideal:.0f}", *parts])
    heads = [f"{count} cameras: {part}" for count in cameras for part in ("error", "in 50, 90 %", "width of 90 %")]
    return markdown((f"{SHOWN}: angle, degrees", "ideal", *heads), cells)


def _below(values: Sequence[float], goal: float) -> str:
    _, low, high = mean_interval(values)
    return "holds" if high <= goal else "does not hold" if low > goal else "undecided"


def _inside(values: Sequence[float]) -> str:
    _, low, high = mean_interval(values)
    inside = HELD[0] <= low and high <= HELD[1]
    return "holds" if inside else "does not hold" if high < HELD[0] or low > HELD[1] else "undecided"


def clocks(tables: Tables) -> str:
    """Errors of offsets, and cameras that are lost, by lateness, clutter and the size of the cameras' errors."""
    records = tables["simulated_clocks"].records()
    columns = ("late", "clutter", "cameras' errors", "recordings", "with offsets", "error, frames", "largest", "reported SD")
    cells, right = [], []
    for case in dict.fromkeys((row["late"], row["clutter"], row["calibration"]) for row in records):
        own = [row for row in records if (row["late"], row["clutter"], row["calibration"]) == case]
        known = [row for row in own if not math.isnan(row["error"])]
        errors, count = [row["error"] for row in known], len(own)
        informed = f"{mean(row['deviation'] for row in known):.2f}"
        of = (("covered", 3 * len(known)), ("wrong", 3 * count), ("lost", 4 * count))
        numbers = [f"{sum(row[name] for row in own)} of {total}" for name, total in of]
        sizes = (_interval(errors, 2), f"{max(errors):.2f}", informed)
        cells.append([*map(str, case), str(count), str(len(known)), *sizes, *numbers])
        right.append(not any(row["wrong"] or row["lost"] for row in own))
    word = "holds" if all(right) else "does not hold"
    table = markdown((*columns, "in 90 % intervals", "wrongly corrected", "cameras lost"), cells)
    return f"{table}\n\nThat no clock is corrected wrongly and no camera lost {word}."


def ranks(tables: Tables) -> str:
    """Ranks of the truth by smoother and cameras, whether they are uniform, and whether wrong smoothers are found out."""
    columns = ("smoother", "cameras", "ranks of", "replicates", "in ten bins, %", "T²", "chance", "ECE", "in 50 %", "in 90 %")
    cells, said = [], []
    for row in tables["smoother_ranks"].records():
        bins = " ".join(f"{100 * row[name]:.1f}" for name in BINS)
        error = f"{row['ece']:.3f} ± {row['ece_error']:.3f}"
        shares = [f"{100 * row[name]:.1f}" for name in SHARES]
        key = [row["smoother"], str(row["cameras"]), row["of"], str(row["replicates"])]
        cells.append([*key, bins, f"{row['statistic']:.1f}", f"{row['chance']:.2g}", error, *shares])
        name = f"{row['of']}, {row['cameras']} cameras, {row['smoother']}"
        uniform, near = row["chance"] > CHANCE, row["ece"] + 2 * row["ece_error"] < ECE
        if row["smoother"] in RIGHT:
            said.append(f"- {name}: uniform {_word(uniform)}; ECE below {ECE:g} {_word(near)}.")
        else:
            said.append(f"- {name}: that it is wrong is {'not ' if uniform else ''}noticed.")
    return f"{markdown(columns, cells)}\n\n" + "\n".join(said)


def _word(holds: bool) -> str:
    return "holds" if holds else "does not hold"
