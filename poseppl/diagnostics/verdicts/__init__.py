"""The diagnostics in words: what is wrong with a result, where, and what to do about it, the worst first.

Each file beside this one has the checks of one subject; a check maps a diagnosed result to its findings, and `CHECKS` lists
those that :func:`verdicts` makes of any result. A check that cannot judge a result yields `not_run`. A package with checks of
its own is listed in :mod:`poseppl.diagnostics.diagnosis`, and has its own `CHECKS` in its module `verdicts`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import xarray as xr

from poseppl.diagnostics.diagnosis import diagnosed, extension_of
from poseppl.diagnostics.verdicts.chains import agreement, divergences, mixing, rejection
from poseppl.diagnostics.verdicts.consistency import (
    check_intervals as check_intervals,
    check_updates as check_updates,
    smoothing,
    updates,
)
from poseppl.diagnostics.verdicts.coverage import coverage, forecasts
from poseppl.diagnostics.verdicts.particles import degeneracy, failures, missing, mode_seeking, run_warnings
from poseppl.diagnostics.verdicts.predictive import (
    check_predictions as check_predictions,
    check_unreached as check_unreached,
    few_points,
    prediction,
    unreached,
)
from poseppl.diagnostics.verdicts.verdict import (
    ERROR as ERROR,
    INFO as INFO,
    NOT_RUN,
    SEVERITIES,
    WARNING as WARNING,
    Remedy as Remedy,
    Verdict as Verdict,
    frame_ranges as frame_ranges,
)

Check = Callable[[xr.DataTree], Iterable[Verdict]]

CHECKS: dict[str, Check] = {
    "impossible data": failures,
    "warnings": run_warnings,
    "mode seeking": mode_seeking,
    "effective particles": degeneracy,
    "number of chains": few_points,
    "divergences": divergences,
    "R-hat": agreement,
    "mixing": mixing,
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


def checks_of(tree: xr.DataTree) -> dict[str, Check]:
    """The checks for a result: those for any, or those of the extension for its kind, which has them among its own."""
    extension = extension_of(tree, "verdicts")
    found: dict[str, Check] = CHECKS if extension is None else extension.CHECKS
    return found


def verdicts(tree: xr.DataTree) -> list[Verdict]:
    """Judge a result.

    Args:
        tree: The result; diagnosed first if it has no group ``diagnostics``.

    Returns:
        Findings, the worst first. If all are of severity "info", the first says how many checks detected no problem, and which
        could not be run.
    """
    whole = diagnosed(tree)
    found = {name: list(check(whole)) for name, check in checks_of(whole).items()}
    findings = [verdict for each in found.values() for verdict in each if verdict.severity != NOT_RUN]
    findings.sort(key=lambda verdict: SEVERITIES.index(verdict.severity))
    if all(verdict.severity == INFO for verdict in findings):
        findings.insert(0, Verdict(INFO, _no_problems(found)))
    return findings


def _no_problems(found: Mapping[str, Sequence[Verdict]]) -> str:
    """How many of the checks for such a result were run, and which were not, by what is missing."""
    reasons = {name: next((each.finding for each in group if each.severity == NOT_RUN), None) for name, group in found.items()}
    others = {reason: [name for name, why in reasons.items() if why == reason] for reason in reasons.values() if reason}
    number, left = sum(reason is None for reason in reasons.values()), sum(map(len, others.values()))
    rest = "; ".join(f"{', '.join(names)} ({reason})" for reason, names in others.items())
    return f"No problems detected by {number} of {number + left} checks." + (f" Not run: {rest}." if rest else "")
