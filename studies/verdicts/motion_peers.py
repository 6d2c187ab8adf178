"""How far joints are from those of four cameras by libraries of their own, for docs/validation/libraries.md."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
OURS, DEFAULT = "poseppl", ("smoother", "filter and smoother")
"""The library, and the method whose answer users get: in older tables there was a filter before the smoother."""
MEASURES = {
    "median": "median",
    "percentile_95": "95th percentile",
    "held_out": "left-out keypoints' median",
    "held_out_95": "their 95th percentile",
}
"""Columns of the points that all methods estimate, mm, and of keypoints, px."""
_ERRORS = ("median", "percentile_95", "own_median", "own_percentile_95", "published", "held_out", "held_out_95")
_SHARES = ("coverage_50", "coverage_90", "joints_50", "joints_90")
_ERROR_COLUMNS = ("median, mm", "95 %", "own: median", "95 %", "published: median", "left out: median, px", "95 %", "no answer")
_SHARE_COLUMNS = ("left out: coverage of 50 %", "90 %", "joints: coverage of 50 %", "90 %", "first run, s", "later run, s")


def motion_peers(tables: Tables) -> str:
    """Errors, intervals and seconds by cameras and library, and with which of them the default's errors are the smallest."""
    records = tables["motion_peers"].records()
    errors = [[*_named(row), *(f"{row[name]:.1f}" for name in _ERRORS), f"{row['missing']:.1%}"] for row in records]
    rest = [
        [
            *_named(row),
            *(_percent(row[name]) for name in _SHARES),
            *(_seconds(row[name]) for name in ("first_seconds", "seconds")),
        ]
        for row in records
    ]
    sets = list(dict.fromkeys(row["cameras"] for row in records))
    compared = [_compared([row for row in records if row["cameras"] == cameras]) for cameras in sets]
    least = sum(number for _, number in compared)
    return "\n\n".join(
        (
            markdown(("cameras", "library", "method", *_ERROR_COLUMNS), errors),
            markdown(("cameras", "library", "method", *_SHARE_COLUMNS), rest),
            "\n".join(sentence for sentence, _ in compared),
            f"poseppl has the lowest error in {least} of these {len(sets) * len(MEASURES)} comparisons.",
        )
    )


def _named(row: Mapping[str, Any]) -> list[str]:
    return [row["cameras"].replace("-", ", "), row["library"], row["method"]]


def _percent(share: float) -> str:
    return "" if math.isnan(share) else f"{share:.1%}"


def _seconds(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.2g}"


def _compared(rows: Sequence[Mapping[str, Any]]) -> tuple[str, int]:
    """Errors of the default and the others' smallest, for one set of cameras, and how many are no larger."""
    ours = next(row for row in rows if row["library"].startswith(OURS) and row["method"] in DEFAULT)
    others = [row for row in rows if not row["library"].startswith(OURS)]
    sentences, smaller = [], 0
    for name, title in MEASURES.items():
        best = min(others, key=lambda row: row[name])
        smaller += ours[name] < best[name]
        word = "smaller" if ours[name] < best[name] else "no smaller"
        whose = f"{best['library'].split()[0]}, {best['method']}"
        sentences.append(f"{title} {ours[name]:.1f}, {word} than the least of the others ({best[name]:.1f}, {whose})")
    return f"* Cameras {rows[0]['cameras'].replace('-', ', ')}: {'; '.join(sentences)}.", smaller
