"""Modes as the report shows them: probabilities over time, ghosts in space, and when each ambiguity arose and was resolved."""

from __future__ import annotations

from typing import Any

import numpy as np
from plotly import graph_objects as go

from poseppl.arrays import Integers
from poseppl.diagnostics.modes import Modes, ambiguities
from poseppl.diagnostics.selection import evenly
from poseppl.report.chart import chart, line
from poseppl.report.picture import MODES

MAX_POINTS, MAX_ROWS = 600, 10


def mode_chart(modes: Modes) -> go.Figure | None:
    """Probability of each mode over the frames, one upon the other; none where all frames have a single mode."""
    chosen = evenly(len(modes.frames), MAX_POINTS)
    traces = [
        line(modes.frames[chosen], 100 * mass, f"mode {number}", color, stackgroup="modes", fillcolor=color, line_width=0)
        for number, (mass, color) in enumerate(zip(modes.masses[chosen].T, MODES, strict=False), 1)
    ]
    return chart(traces, "probability (%)", height=220, yaxis_range=[0, 100]) if len(traces) > 1 else None


def ghosts(modes: Modes, frames: Integers) -> dict[str, Any] | None:
    """Mean markers (frame, mode, marker, axis) and probabilities (frame, mode) of the modes in some frames, by number.

    None where no frame has several modes, or the result has no markers.
    """
    if modes.means.ndim != 4 or modes.masses.shape[1] < 2:
        return None
    rows = np.searchsorted(modes.frames, frames)
    return {"markers": modes.means[rows], "masses": modes.masses[rows], "colors": MODES}


def ambiguity_table(modes: Modes) -> list[dict[str, Any]]:
    """The stretches of frames that have several modes, the longest first."""
    end = int(modes.frames[-1]) + 1
    found = sorted(ambiguities(modes), key=lambda each: each.arose - (end if each.resolved is None else each.resolved))
    return [
        each._asdict() | {"resolved": "never" if each.resolved is None else str(each.resolved)} for each in found[:MAX_ROWS]
    ]
