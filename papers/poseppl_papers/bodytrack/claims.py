"""Results of the benchmark's own tracker: its figures and ours."""

from __future__ import annotations

from poseppl_papers.experiment import Claim, Tables, claims_by_table, on_one_recording, verdict_of
from poseppl_papers.measured import MATTERS, Interval, Measured, difference, find

SCORES = {"initial": -0.3068, "reference": -0.2945}
"""Values of the benchmark's likelihood, to four digits."""
ESTIMATES = {
    "annealed, 5 x 1,000": Measured(-0.2972, 0.0020, 10),
    "annealed, 5 x 4,000": Measured(-0.2971, 0.0022, 10),
}
"""Scores of its own estimates over ten seeds."""
GAIN = MATTERS * (ESTIMATES["annealed, 5 x 4,000"].mean - SCORES["initial"])
"""The smallest difference of scores that matters: a tenth of what the benchmark's own tracker gains on its first pose."""
CROSSED, PLAIN = "annealed, 20 x 250, limbs crossed", "annealed, 20 x 250"
_ROUNDING = 5e-5


def _scores(tables: Tables) -> list[Claim]:
    found = []
    for name, theirs in SCORES.items():
        for row in tables["poses"].records(figure=f"score of the {name} pose"):
            verdict = verdict_of(abs(row["value"] - theirs) <= _ROUNDING)
            ours = f"{row['value']:.4f}"
            found.append(
                Claim(f"Log-likelihood of the {name} pose", f"{theirs}", ours, verdict, "to the digits that they have")
            )
    return found


def _estimates(tables: Tables) -> list[Claim]:
    table, found = tables["estimates"], []
    names = table.values("method")
    for method, theirs in ESTIMATES.items():
        if method in names:
            ours = find(table, "mean", method=method)
            found.append(Claim(f"Score of the estimate, {method}", theirs.text(4), ours.text(4), *_as_good(ours, theirs)))
    if {CROSSED, PLAIN} <= set(names):
        crossed, plain = (find(table, "mean", method=method) for method in (CROSSED, PLAIN))
        gain, error = difference(crossed, plain)
        what = "Children that inherit limbs find better poses with as many evaluations (Deutscher, Davison and Reid 2001)"
        ours_told = f"{crossed.text(4)} against {plain.text(4)}"
        verdict = on_one_recording(Interval.around(gain, 2 * error).above(GAIN))
        why = (
            f"{gain:.4f} +- {error:.4f} more; by more than {GAIN:.4f}, a tenth of the benchmark's own gain, two standard errors"
        )
        found.append(Claim(what, "better", ours_told, verdict, why))
    return found


def _as_good(ours: Measured, theirs: Measured) -> tuple[str, str]:
    """Is ours as good as theirs, or better?"""
    gain, error = difference(ours, theirs)
    verdict = on_one_recording(Interval.around(gain, 2 * error).above(-GAIN))
    return verdict, f"{gain:+.4f} +- {error:.4f}; worse by less than {GAIN:.4f}, two standard errors over runs"


claims = claims_by_table({"poses": [_scores], "estimates": [_estimates]})
