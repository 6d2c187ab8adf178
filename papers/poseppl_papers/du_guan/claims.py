"""The published claims: theirs and ours, whether each holds, and which numbers say so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from poseppl_papers.du_guan.mueller import BASINS, DEMC, DYNAMICS, EXACT, TEMPERED
from poseppl_papers.du_guan.plan import PREDICTIONS
from poseppl_papers.experiment import Claim, Tables, claims_by_table, verdict_of
from poseppl_papers.images.tables import filter_rows
from poseppl_papers.images.tracking import HOLDING
from poseppl_papers.measured import Interval, measured

NEAR = 20.0
"""Percent by which the share of a basin may be off."""
TRAPPED = 90.0
"""Percent of the samples in the basin of the start of which they are said to be trapped."""


def _weights(tables: Tables) -> Claim:
    rows = filter_rows(tables, "trackers")
    weight = {row["method"]: measured(row, "weight") for row in rows}
    error = {row["method"]: measured(row, "absolute") for row in rows}
    plain, annealed, *ours = (
        [name for name in weight if name.startswith(start)][-1]
        for start in ("CONDENSATION", "APF", *(f"DE-MC ({prediction})" for prediction in PREDICTIONS))
    )
    told = " and ".join(f"{weight[name].mean:.3f}" for name in ours)
    far = " and ".join(error[name].told() for name in ours)
    here = (
        f"weights {told} (prediction by velocity; by the random walk) against {weight[plain].mean:.3f} (CONDENSATION) and "
        f"{weight[annealed].mean:.3f} (annealed)"
    )
    why = f"errors {far} mm against {error[plain].told()} and {error[annealed].told()}"
    rivals = max(weight[plain].mean, weight[annealed].mean)
    some = any(weight[name].mean > weight[plain].mean for name in ours)
    verdict = verdict_of(all(weight[name].mean > rivals for name in ours))
    verdict = "holds against CONDENSATION alone" if some and verdict != "holds" else verdict
    what = "Fig. 4: with 70 % of the evaluations DE-MC of 7 layers has more average weight than CONDENSATION and annealing"
    return Claim(what, "more", here, verdict, why)


def _sequences(tables: Tables) -> list[Claim]:
    """Whether each sequence is followed more closely than by a tracker that holds the first pose, a low bar."""
    held = {row["scene"]: row["absolute"] for row in tables["sequences"].records(method=HOLDING)}
    found = []
    for row in filter_rows(tables, "sequences"):
        error, bar = measured(row, "absolute"), held[row["scene"]]
        what = f"Section 4, Fig. 3: {row['method'].replace('DE-MC (velocity), ', '')} particles follow {row['scene']}"
        ours = f"{error.told()} mm in {row['runs']} runs; a tracker that holds the first pose {bar:.0f}"
        found.append(
            Claim(
                what,
                "satisfactory",
                ours,
                error.interval.below(bar),
                "closer than the first pose, by two standard errors over runs",
            )
        )
    return found


def _layers(tables: Tables) -> Claim:
    told, fewer = [], []
    for prediction in PREDICTIONS:
        rows = [row for row in filter_rows(tables, "trackers") if row["method"].startswith(f"DE-MC ({prediction})")]
        told.append(", ".join(f"{row['weight']:.3f}" for row in rows) + f" ({prediction})")
        weights = [row["weight"] for row in rows]
        fewer.append(weights == sorted(weights, reverse=True))
    why = "fewer layers have more weight here" if all(fewer) else "no order here either"
    return Claim("Fig. 5: 2, 5 and 7 layers compared", "no order told", f"weights {'; '.join(told)}", "none: no claim", why)


def _basins(tables: Tables) -> list[Claim]:
    table, found = tables["mueller"], []
    for temperature in table.values("temperature"):
        rows = {row["method"]: row for row in table.records(temperature=temperature)}
        found += [_sampled(rows, temperature), _trapped(rows[DYNAMICS], temperature)]
    return found


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
