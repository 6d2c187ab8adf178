"""The published claims, theirs and ours, whether each holds, and how the page tells the tables."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from poseppl_papers.du_guan.mueller import BASINS, DEMC, DYNAMICS, EXACT, TEMPERED
from poseppl_papers.du_guan.plan import PREDICTIONS, SYSTEM, TUNED
from poseppl_papers.experiment import FAILS, HOLDS, Claim, Tables, all_of, claims_by_table, on_one_recording, verdict_of
from poseppl_papers.images.tables import filter_rows, told_errors
from poseppl_papers.images.tracking import HOLDING
from poseppl_papers.measured import MATTERS, Interval, Measured, measured
from poseppl_papers.tables import grouped, markdown, rows_of

NEAR = 20.0
"""Percent by which the share of a basin may be off."""
LAYERS = "7 layers"
"""In the names of the filters of Fig. 4."""
ERRORS = ("absolute", "relative")
"""In place, and with the pelvises together."""
_BY = f"by more than {100 * MATTERS:.0f} %, by two standard errors over runs"
TRAPPED = 90.0
"""Percent of the samples in the basin of the start of which they are said to be trapped."""


def _weights(tables: Tables) -> list[Claim]:
    """One claim for each prediction and noise of DE-MC."""
    rows = filter_rows(tables, "trackers")
    weight, error = ({row["method"]: measured(row, name) for row in rows} for name in ("weight", "absolute"))
    rivals = [next(name for name in weight if name.startswith(start)) for start in ("CONDENSATION", "APF")]
    found = []
    for name in (name for name in weight if LAYERS in name):
        verdicts = {rival: on_one_recording(_more(weight[name], weight[rival])) for rival in rivals}
        what = f"Fig. 4: with 70 % of the evaluations {name} has more average weight than CONDENSATION and annealing"
        here = f"{weight[name].text(3)} against {' and '.join(weight[rival].text(3) for rival in rivals)}"
        why = f"errors {error[name].text()} mm against {' and '.join(error[rival].text() for rival in rivals)}; {_BY}"
        verdict = "; ".join(f"{rival.partition(',')[0]}: {verdict}" for rival, verdict in verdicts.items())
        found.append(Claim(what, "more", here, verdict, why))
    return found


def _more(ours: Measured, rival: Measured) -> str:
    """Verdict on the claim that a weight is larger than another by what matters."""
    less = 1 + MATTERS
    reach = 2 * math.hypot(ours.error, less * rival.error)
    return Interval.around(ours.mean - less * rival.mean, reach).above(0)


def _sequences(tables: Tables) -> list[Claim]:
    """Whether each sequence is followed more closely than by a tracker that holds the first pose, in place and in posture."""
    held = {row["scene"]: row for row in tables["sequences"].records(method=HOLDING)}
    found = []
    for row in filter_rows(tables, "sequences"):
        error = {name: measured(row, name) for name in ERRORS}
        bar: dict[str, float] = {name: held[row["scene"]][name] for name in ERRORS}
        closer = {name: error[name].interval.below((1 - MATTERS) * bar[name]) for name in ERRORS}
        size = row["method"].removeprefix("DE-MC (velocity), ").removesuffix(TUNED)
        tuned = f"{TUNED}," if row["method"].endswith(TUNED) else ""
        what = f"Section 4, Fig. 3: {size} particles{tuned} follow {row['scene']}"
        text = " and ".join(f"{name} {error[name].text()} mm against {bar[name]:.0f}" for name in ERRORS)
        verdict = (
            f"{on_one_recording(all_of(closer.values()))} ({', '.join(f'{name} {each}' for name, each in closer.items())})"
        )
        ours = f"{text}, which a tracker has that holds the first pose; {row['runs']} runs"
        found.append(Claim(what, "satisfactory", ours, verdict, f"both errors are lower; {_BY}"))
    return found


def _layers(tables: Tables) -> Claim:
    parts, fewer = [], []
    for prediction in PREDICTIONS:
        rows = [row for row in filter_rows(tables, "trackers") if row["method"].startswith(f"DE-MC ({prediction})")]
        rows = [row for row in rows if not row["method"].endswith(TUNED)]
        parts.append(", ".join(f"{row['weight']:.3f}" for row in rows) + f" ({prediction})")
        weights = [row["weight"] for row in rows]
        fewer.append(weights == sorted(weights, reverse=True))
    why = "fewer layers have more weight here" if all(fewer) else "no order here either"
    return Claim("Fig. 5: 2, 5 and 7 layers compared", "no order stated", f"weights {'; '.join(parts)}", "none: no claim", why)


def _basins(tables: Tables) -> list[Claim]:
    table = tables["mueller"]
    rows = {
        temperature: {row["method"]: row for row in table.records(temperature=temperature)}
        for temperature in table.values("temperature")
    }
    pairs = {
        temperature: (_sampled(own, temperature), _trapped(own[DYNAMICS], temperature)) for temperature, own in rows.items()
    }
    return [*(claim for pair in pairs.values() for claim in pair), _both(pairs)]


def _both(pairs: Mapping[float, tuple[Claim, Claim]]) -> Claim:
    """Whether one temperature has both published observations, which are of one surface."""
    verdicts = {temperature: all_of(claim.verdict for claim in pair) for temperature, pair in pairs.items()}
    text = "; ".join(
        f"at {temperature:g} well {sampled.verdict}, trapped {trapped.verdict}"
        for temperature, (sampled, trapped) in pairs.items()
    )
    verdict = verdict_of(HOLDS in verdicts.values(), set(verdicts.values()) == {FAILS})
    what = "Section 2.2: at one temperature the standard dynamics is trapped and DE-MC samples well"
    return Claim(what, "both", text, verdict, "the two rows of each temperature together")


def _sampled(rows: Mapping[str, Mapping[str, Any]], temperature: float) -> Claim:
    """Whether every basin has its due after 30 iterations of DE-MC, within a margin."""
    exact, ours = rows[EXACT], rows[DEMC]
    off = [(abs(ours[name] - exact[name]), ours[f"{name}_reach"]) for name in BASINS]
    verdict = verdict_of(all(far + reach <= NEAR for far, reach in off), any(far - reach > NEAR for far, reach in off))
    best = max((name for name in rows if name not in (EXACT, TEMPERED, DYNAMICS)), key=lambda name: rows[name]["a"])
    what = f"Section 2.2, Fig. 2b: 30 iterations sample Mueller's surface well, at temperature {temperature:g}"
    here = f"{ours['a']:.0f} +- {ours['a_reach']:.1g} % in the deepest basin instead of {exact['a']:.0f} %"
    why = f"well is within {NEAR:.0f} points in each basin; of the methods that start in one basin, {best} has most there"
    return Claim(what, "well", here, verdict, why)


def _trapped(row: Mapping[str, Any], temperature: float) -> Claim:
    """Whether the standard dynamics stays in the basin that it starts from, the second deepest."""
    share, reach = row["b"], row["b_reach"]
    verdict = Interval.around(share, reach).above(TRAPPED)
    what = f"Section 2.2: after 6,000 steps of the standard dynamics samples are in the basin of the start, at {temperature:g}"
    here = f"{share:.0f} +- {reach:.1g} % of them"
    return Claim(what, "trapped", here, verdict, f"trapped is more than {TRAPPED:.0f} %; Langevin's dynamics with rejections")


claims = claims_by_table({"trackers": [_weights, _layers], "sequences": [_sequences], "mueller": [_basins]})


def trackers(tables: Tables) -> str:
    """Errors and average sample weights of the filters."""
    rows = []
    for row in filter_rows(tables, "trackers"):
        weight = measured(row, "weight").text(3)
        shown = [row["method"], f"{row['evaluations']:,}", weight, *told_errors(row), f"{row['seconds']:.2g}"]
        rows.append([*shown, str(row["failed"]), str(row["runs"])])
    columns = ("filter", "evaluations", "weight", "error", "relative", "best particle", "s a frame", "frames failed", "runs")
    return markdown(columns, rows)


def sequences(tables: Tables) -> str:
    """Errors on each sequence beside those of a tracker that holds the first pose."""
    held = {row["scene"]: row for row in rows_of(tables, "sequences", method=HOLDING)}
    rows = []
    for row in filter_rows(tables, "sequences"):
        blind = " and ".join(f"{held[row['scene']][name]:.0f}" for name in ("absolute", "relative"))
        shown = [row["scene"], row["method"], *told_errors(row), blind, f"{row['seconds']:.2g}"]
        rows.append([*shown, str(row["failed"]), str(row["runs"])])
    columns = (
        "sequence",
        "filter",
        "error",
        "relative",
        "best particle",
        "first pose held",
        "s a frame",
        "frames failed",
        "runs",
    )
    return markdown(columns, rows)


def scales(tables: Tables) -> str:
    """Errors of sequence 1 over the scales of cues."""
    rows = [
        ["as above" if row["system"] == SYSTEM.name else row["system"].replace("_", " "), *told_errors(row), str(row["runs"])]
        for row in filter_rows(tables, "scales")
    ]
    return markdown(("scales", "error", "relative", "best particle", "runs"), rows)


def noise(tables: Tables) -> str:
    """Errors over c, readings of Eq. 7 and sigmas, on walks that are not among the sequences."""
    groups = grouped(filter_rows(tables, "noise"), lambda row: row["method"])
    rows = []
    for name, own in groups.items():
        errors = [[measured(row, column) for row in own] for column in ("absolute", "relative", "optimistic")]
        mean = sum(each.mean for each in errors[0]) / len(own)
        cells = [", ".join(each.text() for each in column) for column in errors]
        rows.append([*name.split(", "), f"{mean:.0f}", *cells, str(own[0]["runs"])])
    if not rows:
        return ""
    held = rows_of(tables, "noise", method=HOLDING)
    columns = (
        "c",
        "noise by the",
        "sigma of the",
        "mean error",
        "error on each walk",
        "relative",
        "best particle",
        "runs of each",
    )
    blind = " and ".join(", ".join(f"{row[column]:.0f}" for row in held) for column in ("absolute", "relative"))
    return f"{markdown(columns, rows)}\n\nA tracker that holds the first pose has errors of {blind} mm."


def mueller(tables: Tables) -> str:
    """Shares of the basins."""
    rows = [
        [f"{row['temperature']:g}", row["method"], ", ".join(_share(row, name) for name in BASINS)]
        for row in rows_of(tables, "mueller")
    ]
    return markdown(("temperature", "method", "share in A, B, C (%)"), rows)


def _share(row: Mapping[str, Any], basin: str) -> str:
    """A share, with its reach where it is a mean of runs."""
    return f"{row[basin]:.3g}" + (f" +- {row[f'{basin}_reach']:.2g}" if row["runs"] else "")
