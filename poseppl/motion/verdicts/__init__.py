"""The checks of tracking, which :func:`poseppl.diagnostics.verdicts` makes of results with a body."""

from __future__ import annotations

from itertools import takewhile

from poseppl.diagnostics.verdicts import CHECKS as _OF_ANY, Check
from poseppl.motion.verdicts.agreement import coverage, missing, overlap, prediction, silhouette_jumps
from poseppl.motion.verdicts.residuals import one_camera, point_residuals
from poseppl.motion.verdicts.steps import estimated_steps, learned_prior

_CAUSES = takewhile(lambda name: name != "divergences", _OF_ANY)

CHECKS: dict[str, Check] = {
    **{name: _OF_ANY[name] for name in _CAUSES},
    "learned activity": learned_prior,
    "silhouettes": overlap,
    "silhouette jumps": silhouette_jumps,
    "steps": estimated_steps,
    "single camera": one_camera,
    "residuals of points": point_residuals,
    **_OF_ANY,
    "predictions": prediction,
    "coverage": coverage,
    "missing data": missing,
}
"""The checks by name: those of any result, with its own before those of what they cause."""
