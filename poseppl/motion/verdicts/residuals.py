"""Residuals of image points, in units of what they should be (:mod:`poseppl.motion.verdicts.image_errors`).

If the noise alone is wrong, intervals of a run of scale 1.2 are as much too narrow, and hold 83 % where they promise 90 %; at
1.1 they hold 87 %.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.arrays import Floats
from poseppl.diagnostics.batches import log_ratio
from poseppl.diagnostics.verdicts.verdict import ERROR, INFO, WARNING, Findings, Remedy, Verdict, not_run
from poseppl.motion.verdicts.image_errors import ImageErrors, image_errors
from poseppl.motion.verdicts.remedies import ANGLE, POSITION, in_one_camera, of_walk
from poseppl.runs.contents import names_of
from poseppl.runs.results import provenance

SCALE_HIGH, SCALE_ERROR = 1.1, 1.2
"""Scales of all points above which their verdict is a warning, an error."""
SCALE_LOW = 0.7
MAX_LEFT_OUT = 0.5
"""Largest share of points whose posterior SD hides their noise. Above it the other points do not judge the noise either: they
are a minority, selected by a small SD, of a posterior that the projection bends."""
CAMERA_HIGH, CAMERA_ERROR = 1.15, 1.3
"""Scales of one camera that stands out, above which its verdict is a warning, an error."""
STANDS_OUT = 1.05
"""Factor by which the scale of a camera that stands out exceeds that of all points."""
MARKER_HIGH = 2.0
MAX_NAMED = 4
BIAS_HIGH = 0.7
"""Median residual of a camera, in units of its noise, from which on it is reported."""
_OF_CAMERA = (
    Remedy("check its calibration ({})", "camera"),
    Remedy("check its calibration ({})", "calibration"),
    Remedy("check its time offset, and that it shows the same person"),
)
_OF_MARKERS = (
    Remedy("check the lengths ({})", "stature"),
    Remedy("check the lengths ({})", "model"),
    Remedy("check what the detector calls these joints"),
)


def point_residuals(tree: xr.DataTree) -> Findings:
    """Points farther from the body than noise and posterior allow, or nearer; by camera and marker."""
    errors, markers = image_errors(tree), names_of(tree, "marker")
    if errors is not None and errors.cameras and markers:
        if errors.left_out > MAX_LEFT_OUT:
            share = f"for {100 * errors.left_out:.0f} % of the image points the posterior SD is larger than the noise"
            yield Verdict(INFO, f"The noise of the image points cannot be judged by their residuals: {share}.")
        else:
            yield from _overall(tree, errors, markers)
            yield from _of_markers(errors, markers)
        yield from _of_cameras(errors)
    else:
        yield not_run()


def one_camera(tree: xr.DataTree) -> Findings:
    """A detector's keypoints of a single camera, whose intervals have too low a coverage (studies/one_camera.py)."""
    if in_one_camera(tree):
        known = provenance(tree)
        remedies = [Remedy("omit {}", "walk")] if known.get("settings", {}).get("walk") != "mean-reverting" else []
        remedies += [Remedy("smooth with assumed-density")] if known.get("smoother") == "laplace" else []
        if remedies:
            text = "One camera: estimated joints tend to be too near to it, by more than the intervals allow:"
            yield Verdict(WARNING, text, (*remedies, Remedy("add a camera")))
    else:
        yield not_run()


def _overall(tree: xr.DataTree, errors: ImageErrors, markers: list[str]) -> Findings:
    scale, low, high = _interval(errors)
    text = f"Image points are {scale:.2f} times as far from the body as noise and posterior allow"
    if scale > SCALE_HIGH and low > 1:
        worst = [_largest(errors.scale((0, 1, 3)), markers)]
        if len(errors.cameras) > 1:
            worst.insert(0, _largest(errors.scale((0, 2, 3)), errors.cameras))
        text += f" (worst {', '.join(worst)}{_without(errors)})"
        remedies = Remedy("raise {} by that factor", "noise"), Remedy("correct the calibration or the lengths")
        severity = ERROR if scale > SCALE_ERROR else WARNING
        yield Verdict(severity, f"{text}:", (*remedies, *of_walk(tree, "raise {}", ANGLE, POSITION)))
    if scale < SCALE_LOW and high < 1 and not in_one_camera(tree):
        yield Verdict(WARNING, f"{text}: intervals are too wide;", (Remedy("lower {} by that factor", "noise"),))


def _of_cameras(errors: ImageErrors) -> Findings:
    """Cameras that stand out among others, by scale or by median."""
    if len(errors.cameras) < 2:
        return
    scales = errors.scale((0, 2, 3))
    high = (scales > CAMERA_HIGH) & (scales > STANDS_OUT * errors.scale())
    bias = np.linalg.norm(errors.standardised_bias, axis=-1)
    for i in np.flatnonzero(high | (bias > BIAS_HIGH)):
        said = [f"{scales[i]:.2f} times as far from the body as they should be"] if high[i] else []
        if bias[i] > BIAS_HIGH:
            right, down = errors.bias[i]
            said.append(f"off by ({right:+.3g}, {down:+.3g}) in the median, {bias[i]:.1f} times their noise")
        severity = ERROR if high[i] and scales[i] > CAMERA_ERROR else WARNING
        yield Verdict(severity, f"Points of camera {errors.cameras[i]} are {', and '.join(said)}:", _OF_CAMERA)


def _of_markers(errors: ImageErrors, markers: list[str]) -> Findings:
    scales = errors.scale((0, 1, 3))
    high = [i for i in np.argsort(-np.nan_to_num(scales)) if scales[i] > MARKER_HIGH]
    if 0 < len(high) <= len(markers) / 2:
        named = ", ".join(f"{markers[i]} {scales[i]:.1f}" for i in high[:MAX_NAMED])
        yield Verdict(WARNING, f"Markers are too far from the body, by factors of {named}:", _OF_MARKERS)


def _interval(errors: ImageErrors) -> tuple[float, float, float]:
    """Scale over all points, and its 95 % interval over batches of frames; no interval of a single frame."""
    square, expected = errors.sums((1, 2, 3))
    seen = (expected > 0) & (square > 0)
    if seen.sum() < 2:
        return float(errors.scale()), -np.inf, np.inf
    centre, _, reach = log_ratio(square[seen], expected[seen])
    scale, low, high = np.exp(np.array([centre, centre - reach, centre + reach]) / 2).tolist()
    return scale, low, high


def _without(errors: ImageErrors) -> str:
    """How many points the scale does not count."""
    share = 100 * errors.left_out
    return f"; without the {share:.0f} % of points whose posterior SD is larger than their noise" if share >= 1 else ""


def _largest(scales: Floats, names: list[str]) -> str:
    index = int(np.nanargmax(scales))
    return f"{names[index]} {scales[index]:.2f}"
