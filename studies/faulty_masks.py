"""Masks of the built-in walk in three cameras, drawn from its body, with a second person beside."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.bodies.silhouettes import full_body

from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.batch_last import batch_last
from poseppl.motion.geometry.coverage import hard_coverage, part_distances, project_parts
from poseppl.motion.geometry.flesh import parts_of
from poseppl.motion.io import CameraRecord
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.silhouettes.data import SilhouetteData
from poseppl.motion.silhouettes.scene import silhouette_scene
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.scene import Scene

SIZE = (320, 240)


def masked_walk(count: int, *, other: float | None = None, since: int | None = None) -> Scene[SilhouetteData]:
    """The walk as masks.

    Args:
        count: Frames.
        other: How far aside a second person walks, mm; None for nobody.
        since: Frame from which on the masks show the other person alone; None if they show both throughout.
    """
    subject = walking_subject(frames=f"0:{count}")
    body = full_body(subject.body.lengths)
    records = [_record(f"cam{i}", angle, subject.states[:, :3].mean(0)) for i, angle in enumerate((0.4, 1.9, 4.0))]
    cameras = cameras_of_records(records)
    masks = _drawn(body, cameras, subject.states)
    if other is not None:
        aside = subject.states.copy()
        aside[:, :2] += other / np.sqrt(2)
        second = _drawn(body, cameras, aside)
        masks = masks | second if since is None else np.where(np.arange(count)[:, None, None, None] < since, masks, second)
    named = {record.name: masks[:, i].astype(np.uint8) for i, record in enumerate(records)}
    scene = silhouette_scene(body, records, named, rate=subject.rate)
    return scene._replace(states=subject.states, markers=subject.markers)


def _record(name: str, angle: float, middle: Any) -> CameraRecord:
    """A level camera at 5 m from a place, at an angle about Z."""
    matrix = np.array([[300.0, 0, (SIZE[0] - 1) / 2], [0, 300.0, (SIZE[1] - 1) / 2], [0, 0, 1.0]])
    forward = np.array([-np.sin(angle), np.cos(angle), 0.0])
    rotation = np.stack([np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([0, 0, -1.0]), forward])
    centre = np.array([middle[0], middle[1], 900.0]) - 5000.0 * forward
    return CameraRecord(name, matrix, np.zeros(5), rotation, -rotation @ centre, SIZE)


def _drawn(body: Any, cameras: Cameras, states: Any) -> Any:
    """Masks (T, C, H, W) of states (T, d)."""
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    pixels = jnp.asarray(np.stack([columns, rows], -1).reshape(1, -1, 2).repeat(len(cameras.centre), 0), float)

    def covered(tree: Any, flesh: Any, state: Any, cameras: Any, pixels: Any) -> Any:
        return hard_coverage(part_distances(project_parts(cameras, flesh, parts_of(tree, flesh, state)), pixels))

    draw = jax.jit(batch_last(covered))
    drawn = [np.asarray(draw(body.tree, body.flesh, jnp.asarray(state, float), cameras, pixels)) for state in states]
    return np.array(drawn).reshape(len(states), len(cameras.centre), SIZE[1], SIZE[0])
