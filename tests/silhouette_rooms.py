"""A body standing between two cameras, and its own silhouettes, drawn pixel by pixel."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.bodies.silhouettes import choo_fleet_flesh, full_body

from poseppl.motion.geometry.batch_last import batch_last
from poseppl.motion.geometry.coverage import hard_coverage, part_distances, project_parts
from poseppl.motion.geometry.flesh import flesh_of, parts_of
from poseppl.motion.io import CameraRecord
from poseppl.motion.tracking.placing import cameras_of_records

SIZE = (240, 180)


def record(name: str, angle: float) -> CameraRecord:
    """A level camera 4 m from the body's middle, y down, at an angle about Z."""
    focal = 170.0
    matrix = np.array([[focal, 0, (SIZE[0] - 1) / 2], [0, focal, (SIZE[1] - 1) / 2], [0, 0, 1.0]])
    forward = np.array([-np.sin(angle), np.cos(angle), 0.0])
    rotation = np.stack([np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([0, 0, -1.0]), forward])
    centre = np.array([0.0, 0.0, 900.0]) - 4000.0 * forward
    return CameraRecord(name, matrix, np.zeros(5), rotation, -rotation @ centre, SIZE)


RECORDS = (record("left", 0.3), record("right", 1.7))


def body():
    return _body(jnp.result_type(float))


@functools.cache
def _body(dtype):
    """One body for each precision."""
    return full_body()


def pose(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    state = np.array(body().rest, float)
    state[3:] += rng.normal(0, 0.15, len(state) - 3)
    return state


def masks_of(state: np.ndarray) -> dict[str, np.ndarray]:
    """Masks (H, W) of a state by the cameras' names."""
    built = body()
    flesh = flesh_of(built.tree, choo_fleet_flesh(built.lengths))
    cameras = cameras_of_records(RECORDS)
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    pixels = jnp.asarray(np.stack([columns, rows], -1).reshape(1, -1, 2).repeat(len(RECORDS), 0), float)

    def covered(tree, flesh, state, cameras, pixels):
        return hard_coverage(part_distances(project_parts(cameras, flesh, parts_of(tree, flesh, state)), pixels))

    found = jax.jit(batch_last(covered))(built.tree, flesh, jnp.asarray(state, float), cameras, pixels)
    images = np.asarray(found).reshape(len(RECORDS), SIZE[1], SIZE[0]).astype(np.uint8)
    return {each.name: images[number] for number, each in enumerate(RECORDS)}
