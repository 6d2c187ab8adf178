"""The diagnostics in words: what is wrong with a result, where, and what to do about it, the worst first.

Each file beside this one holds the checks of one subject; a check maps a diagnosed result to its findings, and `CHECKS` lists
those that :func:`verdicts` makes. A check that cannot judge a result yields `not_run`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import xarray as xr

from poseppl.diagnostics.diagnosis import diagnosed
from poseppl.diagnostics.verdicts.chains import (
    RHAT_HIGH as RHAT_HIGH,
    RHAT_SHARE as RHAT_SHARE,
    agreement,
    divergences,
    mixing,
    rejection,
)
from poseppl.diagnostics.verdicts.coverage import coverage, forecasts
from poseppl.diagnostics.verdicts.particles import degeneracy, mode_seeking
from poseppl.diagnostics.verdicts.predictive import (
    check_predictions as check_predictions,
    check_unreached as check_unreached,
    few_points,
    prediction,
    unreached,
)
from poseppl.diagnostics.verdicts.residuals import one_camera, point_residuals
from poseppl.diagnostics.verdicts.silhouettes import overlap, silhouette_jumps
from poseppl.diagnostics.verdicts.smoothing import smoothing
from poseppl.diagnostics.verdicts.steps import estimated_steps, learned_prior
from poseppl.diagnostics.verdicts.updates import (
    check_intervals as check_intervals,
    check_updates as check_updates,
    updates,
)
from poseppl.diagnostics.verdicts.validity import failures, missing, run_warnings
from poseppl.diagnostics.verdicts.verdict import (
    ERROR as ERROR,
    INFO as INFO,
    NOT_RUN,
    SEVERITIES,
    WARNING as WARNING,
    Verdict as Verdict,
    frame_ranges as frame_ranges,
)

CHECKS: dict[str, Callable[[xr.DataTree], Iterable[Verdict]]] = {
    "impossible data": failures,
    "warnings": run_warnings,
    "mode seeking": mode_seeking,
    "effective particles": degeneracy,
    "number of chains": few_points,
    "learned activity": learned_prior,
    "silhouettes": overlap,
    "silhouette jumps": silhouette_jumps,
    "steps": estimated_steps,
    "single camera": one_camera,
    "residuals of points": point_residuals,
    "divergences": divergences,
    "mixing": mixing,
    "R-hat": agreement,
    "rejection": rejection,
    "predictions": prediction,
    "weakly informed coordinates": unreached,
    "updates": updates,
    "smoothing": smoothing,
    "forecasts": forecasts,
    "coverage": coverage,
    "missing data": missing,
}
"""The checks by name; among findings of one severity, those of earlier checks come first: causes before effects."""


def verdicts(tree: xr.DataTree) -> list[Verdict]:
    """Judge a result.

    Args:
        tree: The result; diagnosed first if it has no group ``diagnostics``.

    Returns:
        Findings, the worst first. If all are of severity "info", the first says how many checks detected no problem, and which
        could not be run.
    """
    whole = diagnosed(tree)
    found = {name: list(check(whole)) for name, check in CHECKS.items()}
    findings = [verdict for each in found.values() for verdict in each if verdict.severity != NOT_RUN]
    findings.sort(key=lambda verdict: SEVERITIES.index(verdict.severity))
    if all(verdict.severity == INFO for verdict in findings):
        findings.insert(0, Verdict(INFO, _no_problems(found)))
    return findings


def _no_problems(found: Mapping[str, Sequence[Verdict]]) -> str:
    """How many of the checks for such a result were run, and which were not, by what is missing."""
    reasons = {name: next((each.text for each in told if each.severity == NOT_RUN), None) for name, told in found.items()}
    others = {reason: [name for name, why in reasons.items() if why == reason] for reason in reasons.values() if reason}
    number, left = sum(reason is None for reason in reasons.values()), sum(map(len, others.values()))
    rest = "; ".join(f"{', '.join(names)} ({reason})" for reason, names in others.items())
    return f"No problems detected by {number} of {number + left} checks." + (f" Not run: {rest}." if rest else "")
