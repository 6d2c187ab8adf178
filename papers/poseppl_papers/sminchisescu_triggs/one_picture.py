"""Jobs: a person's sizes from one picture in which joints are marked, with the pose (section 2 of the paper)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.bodies.anthropometry import anthropometric_prior
from poseppl_models.sminchisescu_triggs.body import superquadric_body
from poseppl_models.sminchisescu_triggs.programs import cost_noise, seen_in_images
from poseppl_models.sminchisescu_triggs.sizes import SIZES, SizeInputs, size_programs

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.jobs import Job
from poseppl.kernels.constraints import constraints
from poseppl.kernels.mode_search import search_modes
from poseppl.motion.geometry import Cameras, look_at, marker_positions, project
from poseppl.program import CompiledModel, bounded
from poseppl_papers.experiment import Jobs, Results
from poseppl_papers.tables import Table

NOISE = 1.0
"""Standard deviation of marked joints, px."""
COLUMNS = ("person", "size", "true", "standard", "found", "sd", "prior_sd")
_POSED = 0.05
_START = (200.0, 0.2)
_ABOUT = (
    "Sizes (mm) of people drawn from the anthropometric prior: true, the standard humanoid's, and found from one picture with "
    "joints marked to 1 px, with the posterior's and the prior's standard deviation."
)


@dataclass(frozen=True)
class OnePicture(Job):
    """People who are measured.

    Attributes:
        seeds: Seeds of their sizes, poses and pictures.
    """

    seeds: tuple[int, ...]

    @property
    def name(self) -> str:
        """Sizes."""
        return "sizes"


def pointed_at(centre: Sequence[float], target: Sequence[float], focal: float, size: tuple[int, int]) -> Cameras:
    """A level camera, rows going down."""
    middle = jnp.array([[(size[0] - 1) / 2, (size[1] - 1) / 2]])
    return look_at(tuple(centre), tuple(target))._replace(principal=middle, focal=jnp.array([[focal, focal]]))


def size_estimator(model: CompiledModel, number: int, num_steps: int) -> Callable[[Any, Any], tuple[Floats, Floats]]:
    """Compile a search for pose and sizes.

    Args:
        model: Model from ``poseppl_models.sminchisescu_triggs.sizes``.
        number: n, sizes that are estimated.
        num_steps: Steps of the climb.

    Returns:
        (data, inputs) to mean (n,) and covariance (n, n) of the whitened sizes at the mode.
    """
    box = bounded(model)
    limits = constraints(box.model.dimension, lower=box.lower, upper=box.upper)

    @jit
    def search(observation: Any, inputs: Any) -> Any:
        precision = jnp.diag(jnp.concatenate([1 / inputs.start_scale**2, jnp.ones(number)]))
        found = search_modes(
            jnp.concatenate([inputs.start, jnp.zeros(number)])[None],
            lambda x: box.model.log_initial(x, inputs) + box.model.log_observation(x, observation, inputs),
            lambda x: precision + box.model.observation_information(x, observation, inputs),
            limits,
            1,
            num_steps=num_steps,
        )
        return found.modes.moments()

    def estimate(data: Any, inputs: Any) -> tuple[Floats, Floats]:
        means, covariances = search(model.observe(data), inputs)
        return np.asarray(means[0, -number:], float), np.asarray(covariances[0, -number:, -number:], float)

    return estimate


def in_millimetres(names: Sequence[str], mean: Floats, covariance: Floats) -> tuple[Floats, Floats, Floats]:
    """Sizes (n,) and their standard deviations, and those of the prior, mm, from whitened sizes."""
    middle, prior = anthropometric_prior(names)
    root = np.linalg.cholesky(prior)
    return middle + root @ mean, np.sqrt(np.diag(root @ covariance @ root.T)), np.sqrt(np.diag(prior))


def measure_people(job: OnePicture) -> dict[str, Any]:
    """Measure people.

    Returns:
        ``true``, ``found``, ``sd`` and ``prior_sd`` (people, n), mm.
    """
    rows = [_measured(seed) for seed in job.seeds]
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


def _measured(seed: int) -> dict[str, Floats]:
    mean, covariance = anthropometric_prior(SIZES)
    rng = np.random.default_rng([seed, 5])
    true = np.maximum(rng.multivariate_normal(mean, covariance), 0.3 * mean)
    body = superquadric_body("full", dict(zip(SIZES, map(float, true), strict=True)))
    dimension = len(body.rest)
    pose = np.array(body.rest) + np.where(np.arange(dimension) < 6, 0.0, _POSED) * rng.normal(size=dimension)
    pose = np.clip(pose, body.limits[:, 0] + 0.02, body.limits[:, 1] - 0.02)
    camera = pointed_at((500.0, 3500.0, 1000.0), (0.0, 0.0, 900.0), 1000.0, (480, 640))
    exact = np.asarray(project(camera, marker_positions(body.tree, jnp.asarray(pose, float))), np.float64)
    points = exact + rng.normal(0, NOISE, exact.shape)
    found, sd, prior = in_millimetres(SIZES, *_search(points, camera))
    return {"true": true, "found": found, "sd": sd, "prior_sd": prior}


def _search(points: Floats, camera: Cameras) -> tuple[Floats, Floats]:
    """Mean and covariance of the whitened sizes, from a standard person at rest."""
    rest = superquadric_body("full").rest
    scale = jnp.where(jnp.arange(len(rest)) < 3, *_START)
    seen = seen_in_images([np.zeros((16, 16), np.uint8)], rest)
    marked = jnp.full((1, points.shape[1]), NOISE)
    inputs = SizeInputs(camera, marked, seen, cost_noise(), jnp.asarray(rest, float), scale, scale)
    leaves, tree = jax.tree.flatten(jax.eval_shape(lambda values: values, inputs))
    return _estimator(tree, tuple(leaves))({"points": points}, inputs)


@lru_cache(maxsize=1)
def _estimator(tree: Any, shapes: tuple[Any, ...]) -> Callable[[Any, Any], tuple[Floats, Floats]]:
    """One compiled search for all people."""
    return size_estimator(size_programs(contours=False).compile(jax.tree.unflatten(tree, shapes), {}), len(SIZES), 30)


def sizes_table(jobs: Jobs, results: Results) -> list[Table]:
    """A row for each person and size."""
    mean, _ = anthropometric_prior(SIZES)
    rows = [
        (seed, name, *(float(value) for value in (found["true"][i, j], mean[j], *(found[k][i, j] for k in COLUMNS[4:]))))
        for job in jobs["sizes"]
        for found in [results[job.key]]
        for i, seed in enumerate(job.seeds)
        for j, name in enumerate(SIZES)
    ]
    return [Table("sizes", COLUMNS, rows, _ABOUT)]
