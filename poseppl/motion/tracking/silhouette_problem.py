"""The inference problem of silhouettes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from poseppl.motion.bodies.body import SilhouetteInputs
from poseppl.motion.likelihoods import SilhouetteSeen
from poseppl.motion.tracking.problem import Problem
from poseppl.motion.tracking.silhouette_scene import SilhouetteScene, noise_in_pixels
from poseppl.motion.tracking.silhouette_start import seek_silhouette
from poseppl.motion.tracking.start import Start
from poseppl.motion.tracking.walk import step_scales, time_steps
from poseppl.program import CompiledModel
from poseppl.runs.run import Constant, frame_inputs


def silhouette_problem(seen: SilhouetteScene, params: Mapping[str, float] | None = None, start: Start | None = None) -> Problem:
    """Pose the problem of silhouettes.

    Args:
        seen: The scene.
        params: The programs' params; the body's own if None.
        start: Prior of the first state; around the truth where it is known, else sought, if None.

    Raises:
        InputError: No frame has a silhouette.
    """
    body = seen.scene.body
    values = dict(body.params if params is None else params)
    if start is None:
        known = seen.scene.states
        start = seek_silhouette(seen, values) if known is None else Start(known[0], step_scales(body, values))
    fixed: Any = Constant
    inputs = SilhouetteInputs(
        fixed(seen.scene.cameras),
        SilhouetteSeen(
            np.asarray(seen.contour, np.float32),  # type: ignore[arg-type]
            seen.distance,  # type: ignore[arg-type]
            fixed(jnp.asarray(seen.scale, float)),
            seen.edges,  # type: ignore[arg-type]
        ),
        fixed(jnp.asarray(noise_in_pixels(seen, start.mean), float)),
        fixed(jnp.asarray(start.mean, float)),
        fixed(jnp.asarray(start.scale, float)),
        jnp.asarray(step_scales(body, values, time_steps(seen.scene.frames, seen.scene.rate)), float),
        fixed(body.tree),
        fixed(body.flesh),
    )
    model = body.compile(frame_inputs(inputs, 0), values)
    observations = model.observe(
        {"silhouette": np.zeros((len(seen.contour), *_site(model)))}, {"silhouette": _mask(seen, _site(model)[1])}
    )
    return Problem(body, model, observations, inputs)


def _site(model: CompiledModel) -> tuple[int, int]:
    shape = model.unobserved().values["silhouette"].shape
    return int(shape[0]), int(shape[1])


def _mask(seen: SilhouetteScene, entries: int) -> Any:
    """Which residuals count (T, C, entries): points on the outline, and all parts where the camera is usable."""
    rest = entries - seen.on_outline.shape[-1]
    return np.concatenate([seen.on_outline, np.repeat(seen.usable[..., None], rest, 2)], 2)
