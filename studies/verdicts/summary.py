"""The results of all studies in one table, for docs/validation/index.md."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import Any

from poseppl_papers.measured import mean_interval
from poseppl_papers.tables import Table, markdown

from studies.verdicts import default_filter, keypoints, motion_peers, one_camera, predictions, toolkit_speed

Tables = Mapping[str, Table]


def summary(tables: Tables) -> str:
    """A row for each question: the answer, its sample, and the page with the evidence."""
    makers = (_answers, _simulated, _keypoints, _one_camera, _markers, _smoothing, _verdicts, _peers, _speed)
    return markdown(("question", "result", "sample"), [list(make(tables)) for make in makers])


def _answers(tables: Tables) -> tuple[str, str, str]:
    rows = tables["independent_answers"].records()
    worst = max(chain.from_iterable((row["filtered"], row["smoothed"]) for row in rows))
    sample = f"{len({row['model'] for row in rows})} models, {len(rows)} pairs of filter and smoother"
    return "[Are means right?](models.md)", f"largest error {worst:.2g} posterior SD", sample


def _simulated(tables: Tables) -> tuple[str, str, str]:
    rows = tables["simulated_motion"].records(setting="default")
    inside = mean_interval([100 * row["in_90"] for row in rows]).text(".1f")
    question = "[Are intervals of a body right if the model is?](motion.md#simulated-motion)"
    return question, f"coverage of 90 % intervals {inside} %", f"{len(rows)} simulated sequences, one camera"


def _keypoints(tables: Tables) -> tuple[str, str, str]:
    pairs = [row for row in tables["keypoints"].records(method=keypoints.DEFAULT) if str(row["cameras"]) in ("1-4", "2-4")]
    errors, shares = (" and ".join(form(row) for row in pairs) for form in (_median, _coverage))
    result = f"median error {errors} mm from the triangulation by four cameras; coverage of 90 % intervals {shares} %"
    return (
        "[How accurate are keypoints in two cameras?](keypoints.md#a-recording)",
        result,
        "one recording, two pairs of cameras",
    )


def _median(row: Mapping[str, Any]) -> str:
    return f"{row['median']:.1f}"


def _coverage(row: Mapping[str, Any]) -> str:
    return f"{100 * row['coverage_90']:.1f}"


def _one_camera(tables: Tables) -> tuple[str, str, str]:
    noise, walk, method = one_camera.USUAL
    rows = one_camera.of_recordings(tables["one_camera"].records(noise=noise, walk=walk, method=method))
    error = "{:.0f} ± {:.0f}".format(*one_camera.interval(rows, "error"))
    share = "{:.0f} ± {:.0f}".format(*one_camera.interval(rows, "coverage_90", 100.0))
    result = f"mean error {error} mm; coverage of 90 % intervals {share} %"
    return "[And in one camera?](keypoints.md#one-camera)", result, f"{len(rows)} recordings"


def _markers(tables: Tables) -> tuple[str, str, str]:
    cells = default_filter.cells_of(tables["default_filter"].records(), 2, default_filter.FIRST)
    question = "[How accurate are markers in two cameras?](motion.md#the-default-filter)"
    return question, f"mean joint error {cells[4]} mm", f"{cells[2]} recordings, {cells[3]} runs"


def _smoothing(tables: Tables) -> tuple[str, str, str]:
    gains = [_gain(tables, cameras) for cameras in (1, 2, 4)]
    question = "[Does smoothing pay?](smoothing.md#does-smoothing-pay)"
    return question, f"NUTS on all frames removes {', '.join(gains)} % of the error with 1, 2, 4 cameras", "12 runs each"


def _gain(tables: Tables, cameras: int) -> str:
    rows = [row for row in tables["smoothing_pays"].records(seen="points") if int(row["cameras"]) == cameras]
    errors = {(row["walk"], row["seed"], row["method"]): float(row["error"]) for row in rows}
    less = [
        100 * (1 - error / errors[walk, seed, "filter"]) for (walk, seed, name), error in errors.items() if name == "trajectory"
    ]
    return f"{sum(less) / len(less):.0f}"


def _verdicts(tables: Tables) -> tuple[str, str, str]:
    rows = tables["predictive_checks"].records()
    low = [row for row in rows if row["coverage"] < predictions.LEAST]
    high = [row for row in rows if row["coverage"] > predictions.MOST]
    missed, accused = sum(map(predictions.missed, low)), sum(map(predictions.accused, high))
    result = f"{missed} of {len(low)} wrong runs missed, {accused} of {len(high)} correct runs accused"
    return "[Do verdicts notice wrong intervals?](verdicts.md#predictive-checks)", result, f"{len(rows)} runs"


def _peers(tables: Tables) -> tuple[str, str, str]:
    lines = motion_peers.motion_peers(tables).splitlines()
    question = "[How does it compare for keypoints?](libraries.md#for-motion)"
    return question, lines[-1].rstrip("."), "one recording, three sets of cameras, four libraries"


def _speed(tables: Tables) -> tuple[str, str, str]:
    seconds = [row["first_result"] for row in tables["first_results"].records()]
    result = f"{min(seconds):.2f} to {max(seconds):.2f} s of processor time, imports excluded (goal {toolkit_speed.FIRST:g} s)"
    return "[How long is the first result?](speed.md#first-results)", result, f"{len(seconds)} filters of a small model"
