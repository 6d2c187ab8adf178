"""The diagnostics in words: what is wrong with a result, where, and what to do about it, the worst first.

Each file beside this one holds the checks of one subject; a check maps a diagnosed result to its findings, and `CHECKS` lists
those that :func:`verdicts` makes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

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
    SEVERITIES,
    WARNING as WARNING,
    Verdict as Verdict,
    frame_ranges as frame_ranges,
)

CHECKS: tuple[Callable[[xr.DataTree], Iterable[Verdict]], ...] = (
    failures,
    run_warnings,
    mode_seeking,
    degeneracy,
    few_points,
    learned_prior,
    overlap,
    silhouette_jumps,
    estimated_steps,
    one_camera,
    point_residuals,
    divergences,
    mixing,
    agreement,
    rejection,
    prediction,
    unreached,
    updates,
    smoothing,
    forecasts,
    coverage,
    missing,
)
"""The checks; among findings of one severity, those of earlier checks come first: causes before effects."""


def verdicts(tree: xr.DataTree) -> list[Verdict]:
    """Judge a result.

    Args:
        tree: The result; diagnosed first if it has no group ``diagnostics``.

    Returns:
        Findings, the worst first; a single one of severity "info" if there is nothing to complain of.
    """
    whole = diagnosed(tree)
    findings = [verdict for check in CHECKS for verdict in check(whole)]
    findings.sort(key=lambda verdict: SEVERITIES.index(verdict.severity))
    if all(verdict.severity == INFO for verdict in findings):
        findings.insert(0, Verdict(INFO, "Nothing to complain of."))
    return findings
