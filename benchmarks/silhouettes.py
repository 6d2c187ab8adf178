"""Cost of the likelihood of silhouettes: its value, its gradient and its curvature, with and without edges.

    poseppl simulate --video --frames 0:2 --no-clutter -o room
    python -m benchmarks.silhouettes [--quick] [--scene room] [--states 64]

Evaluations a second of states around the truth, side by side, of all of the scene's cameras; ratios to the value in the same
run. The gradient comes with the value; the curvature is J' R^-1 J of all residuals.
"""

from __future__ import annotations

import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.timing import arguments, interleave, show
from poseppl.cli.console import start_jax
from poseppl.motion.io import VideoWarning
from poseppl.motion.silhouettes.frame import SilhouetteSettings
from poseppl.motion.silhouettes.video_sources import see_silhouettes, sources_of_scene
from poseppl.motion.tracking import make_problem
from poseppl.runs.run import frame_inputs


def main() -> None:
    options = arguments(__doc__, scene="room", states=64)
    start_jax()
    rows = []
    for edges in (False, True):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VideoWarning)
            seen = see_silhouettes(sources_of_scene(options.scene), settings=SilhouetteSettings(edges=edges), stop=1)
        rivals = evaluations(seen, options.states)
        found = interleave(rivals, 2 if options.quick else 30)
        for name, timing in found.items():
            rate, ratio = options.states / timing.median, timing.median / found["value"].median
            rows.append([name, "yes" if edges else "no", f"{rate:,.0f}", f"{ratio:.1f}", f"{timing.first:.0f}"])
    title = f"{len(seen.camera_names)} cameras, {options.states} states side by side"
    show(title, ["", "edges", "a second", "times the value", "first call, s"], rows)


def evaluations(seen: Any, number: int) -> dict[str, Any]:
    """Functions without arguments that are timed, by name."""
    problem = make_problem(seen)
    model, inputs = problem.model, frame_inputs(problem.inputs, 0)
    observation = jax.tree.map(lambda leaf: leaf[0], problem.observations)
    truth = np.asarray(problem.inputs.start.value)
    states = jnp.asarray(truth + 0.05 * np.random.default_rng(0).standard_normal((number, len(truth))), float)

    def density(x: jax.Array, observation: Any, inputs: Any) -> jax.Array:
        return model.log_observation(x, observation, inputs)

    functions: dict[str, Any] = {
        "value": density,
        "value and gradient": jax.value_and_grad(density),
        "curvature": model.observation_information,
    }
    compiled = {name: jax.jit(jax.vmap(function, in_axes=(0, None, None))) for name, function in functions.items()}
    return {name: lambda run=run: run(states, observation, inputs) for name, run in compiled.items()}


if __name__ == "__main__":
    main()
