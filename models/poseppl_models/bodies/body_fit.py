"""A body of cones made to fit a person whose joints are known: the sizes, and the poses within the joints' limits.

The joints are virtual markers, as :func:`poseppl.diagnostics.virtual_markers` gives them: the pelvis between the hips, the neck
between the shoulders, the end of the head (``crown``), and six joints of the limbs on either side.

>>> import numpy as np
>>> from poseppl_models.darby.cone_body import darby_body
>>> body = darby_body()
>>> rest = dict(zip(body.tree.marker_names, np.asarray(marker_positions(body.tree, jnp.asarray(body.rest)))[:, None]))
>>> round(fitted_stature(measured_lengths(rest)), 1)
1750.0
>>> states = fitted_states(body, rest)
>>> bool(np.allclose(marker_positions(body.tree, jnp.asarray(states[0])), np.concatenate(list(rest.values())), atol=1.0))
True
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jax import Array
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.errors import InputError
from poseppl.motion.geometry import marker_positions
from poseppl_models.bodies.anthropometry import LENGTH_SHARES
from poseppl_models.bodies.cone_body import ConeBody

MARGIN = 0.05
"""Radians by which fitted poses keep clear of the limits, so that poses around them are possible."""
_PULLS = (20.0, 5.0)
"""Weights (mm a radian) that pull angles towards the frame before and towards rest."""
_HEADINGS = 8
_SEGMENTS = {
    "trunk": ("pelvis", "neck"),
    "head": ("neck", "crown"),
    "shoulder_width": ("neck", "shoulder"),
    "upper_arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
    "hip_width": ("pelvis", "hip"),
    "thigh": ("hip", "knee"),
    "shank": ("knee", "ankle"),
}


def measured_lengths(places: Mapping[str, Any]) -> dict[str, float]:
    """Mean lengths (mm) of the segments between markers, those of both sides together.

    Args:
        places: (T, 3) mm of each marker. ``head`` reaches to the marker ``crown``, which recordings put inside of the head.

    Raises:
        InputError: A marker is missing.
    """
    lengths = {}
    for segment, pair in _SEGMENTS.items():
        spans = [[place for place in (end, f"{end}_{side}") if place in places] for end in pair for side in "lr"]
        if not all(spans):
            raise InputError(f"no marker {' or '.join(pair)} on both sides", field="places", expected="the fifteen markers")
        apart = [np.asarray(places[spans[side][0]]) - np.asarray(places[spans[2 + side][0]]) for side in (0, 1)]
        lengths[segment] = float(np.nanmean(np.linalg.norm(apart, axis=-1)))
    return lengths


def fitted_stature(lengths: Mapping[str, float]) -> float:
    """Stature (mm) whose segments come closest to measured ones by least squares; the head is left out."""
    pairs = np.array([(LENGTH_SHARES[name], length) for name, length in lengths.items() if name != "head"])
    return float(pairs[:, 0] @ pairs[:, 1] / (pairs[:, 0] @ pairs[:, 0]))


def fitted_states(body: ConeBody, places: Mapping[str, Any]) -> Floats:
    """Find the poses (T, d) whose markers lie closest to given ones, within the limits, from frame to frame.

    Args:
        body: The body.
        places: (T, 3) mm of each marker, none of them missing in a frame; those that the body does not have are left out.

    Raises:
        InputError: The body has none of the markers, or one is unknown in a frame.
    """
    index = [number for number, name in enumerate(body.tree.marker_names) if name in places]
    target = (
        np.stack([np.asarray(places[body.tree.marker_names[number]], np.float64) for number in index], 1) if index else None
    )
    if target is None or not np.isfinite(target).all():
        raise InputError("markers are missing", field="places", expected="markers of the body, known in every frame")
    solve = _solver(body, np.array(index))
    root = np.array([axis in ("tx", "ty", "tz") for _, axis in body.tree.coordinates])
    heading = body.tree.coordinates.index((body.tree.joint_names[0], "Z"))
    guesses = np.tile(body.rest, (_HEADINGS, 1))
    guesses[:, root] = target[0].mean(0)
    guesses[:, heading] += 2 * np.pi * np.arange(_HEADINGS) / _HEADINGS
    states = [min((solve(target[0], guess, body.rest) for guess in guesses), key=lambda found: found[1])[0]]
    for frame in target[1:]:
        states.append(solve(frame, states[-1], states[-1])[0])  # noqa: PERF401
    return np.array(states)


def _solver(body: ConeBody, index: NDArray[np.int_]) -> Callable[[Floats, Floats, Floats], tuple[Floats, float]]:
    """Least squares of one frame: (target, guess, frame before) to (state, cost)."""
    free = np.isinf(body.limits).all(1)
    low, high = body.limits[:, 0] + MARGIN, body.limits[:, 1] - MARGIN
    scale = np.where(free, 100.0, 0.3)

    def residuals(x: Array, target: Array, before: Array) -> Array:
        apart = marker_positions(body.tree, x)[index] - target
        to_before, to_rest = (jnp.where(free, 0.0, change) for change in (x - before, x - body.rest))
        return jnp.concatenate([apart.ravel(), _PULLS[0] * to_before, _PULLS[1] * to_rest])

    value, jacobian = jit(residuals), jit(jax.jacrev(residuals))

    def solve(target: Floats, guess: Floats, before: Floats) -> tuple[Floats, float]:
        found = scipy.optimize.least_squares(
            lambda x: np.asarray(value(x, target, before), np.float64),
            np.clip(guess, low + 1e-6, high - 1e-6),
            jac=lambda x: np.asarray(jacobian(x, target, before), np.float64),
            bounds=(low, high),
            x_scale=scale,
            ftol=1e-5,
            max_nfev=100,
        )
        return np.asarray(found.x, np.float64), float(found.cost)

    return solve
