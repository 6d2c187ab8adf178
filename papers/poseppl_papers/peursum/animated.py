"""A quasi-synthetic video (section 7.2): the published body, animated by a recorded walk, before one camera and nothing else.

The person walks straight on, at an angle away from the camera, so that much of the motion is along its axis. The body fits
what is seen exactly. Its pictures are taken apart as those of any video: silhouettes by subtraction of an empty plate, edges by
gradients.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.images.image_system import SeenPerson, Sight, build_system
from poseppl_models.images.silhouette_bits import body_bits, unpack_bits

from poseppl.arrays import Floats
from poseppl.motion.bodies.body import load_builder
from poseppl.motion.bodies.subject import fit_subject
from poseppl.motion.geometry import Cameras, marker_positions
from poseppl.motion.geometry.flesh import parts_of
from poseppl.motion.io import slice_frames
from poseppl.motion.io.opencv import Image, opencv
from poseppl.motion.tracking.marker_errors import VIRTUAL_MARKERS, virtual_markers
from poseppl.motion.tracking.placing import cameras_of_records, place_cameras, records_of_cameras
from poseppl.motion.vision import FeatureSettings, background_from_plate, extract
from poseppl_papers.images.systems import Problem, System
from poseppl_papers.peursum.training import BODY, motion_at
from poseppl_papers.recordings import Recording

PERSON = "poseppl_models.images.image_systems:peursum_person"
VIEW = 150.0
"""Degrees from the front of the person: 30 from straight away."""
DISTANCE, FOCAL = 4000.0, 800.0
"""From the camera to the nearest place of the walk, mm; px."""
GROUND = 110
"""Gray level of the plate; parts are lighter and have hues of their own."""
_SETTINGS = FeatureSettings(flow=None)


@dataclass(frozen=True)
class AnimatedScene:
    """A walk of the published body.

    Attributes:
        recording: Whose walk.
        num_frames: How many frames, from the first on.
        rate: Frames a second.
        width: Width of the images, px.
        height: Height of the images, px.
    """

    recording: Recording
    num_frames: int
    rate: float = 25.0
    width: int = 640
    height: int = 480

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.recording.name}-animated"


def animated_problem(scene: AnimatedScene, system: System) -> Problem:
    """Put a system before the animated body.

    Raises:
        InputError: The recording cannot be read or is too short, or there is no such builder.
    """
    person, truth, images = _filmed(scene)
    sights = list(_sights(images))
    built = build_system(system.builder, person._replace(first=sights[0]), {"views": 1, **dict(system.settings)})
    frames = [built.inputs(sight) for sight in sights]
    return Problem(built, built.program.compile(frames[0], built.params), frames, truth)


@lru_cache(maxsize=2)
def _filmed(scene: AnimatedScene) -> tuple[SeenPerson, Floats, list[Image]]:
    """Person that is seen, without a first frame; the fifteen virtual markers (T, 15, 3), mm; and the pictures."""
    body, states = _animated(scene)
    places = jax.vmap(partial(marker_positions, body.tree))(jnp.asarray(states, float))
    truth = np.asarray(virtual_markers(body.tree.marker_names, places), np.float64)
    size = scene.width, scene.height
    placed = place_cameras(truth[:, 0], 0.0, distance=DISTANCE, view=VIEW)
    cameras = cameras_of_records(records_of_cameras(placed, FOCAL * scene.width / 640, size))
    markers = dict(zip(VIRTUAL_MARKERS, np.moveaxis(truth, 1, 0), strict=True))
    person = SeenPerson(markers, scene.rate, cameras, Sight((), ()))
    return person, truth, draw_body(body, states, cameras, size)


def _animated(scene: AnimatedScene) -> tuple[Any, Floats]:
    """The published body in the person's size, and its poses (T, d)."""
    motion = motion_at(scene.recording, scene.rate)
    walk = fit_subject(slice_frames(motion, f"0:{min(scene.num_frames, len(motion.positions))}"), load_builder(BODY))
    own = np.asarray(virtual_markers(walk.body.tree.marker_names, walk.body.places(walk.states)), np.float64)
    fitting: Any = load_builder(PERSON)
    body, states = fitting(dict(zip(VIRTUAL_MARKERS, np.moveaxis(own, 1, 0), strict=True)))
    return body, np.asarray(states, np.float64)


def draw_body(body: Any, states: Floats, cameras: Cameras, size: tuple[int, int]) -> list[Image]:
    """Pictures (H, W, 3), RGB, of a body of cones in poses (T, d) before a gray ground, near parts over far ones.

    Args:
        body: With a tree and flesh, as :class:`poseppl_models.bodies.cone_body.ConeBody`.
        states: Poses.
        cameras: One camera, px.
        size: Width and height, px.
    """
    width, height = size
    tree, flesh, eyes = jax.tree.map(lambda leaf: jnp.asarray(leaf)[..., None], (body.tree, body.flesh, cameras))
    parts = parts_of(tree, flesh, jnp.asarray(states.T, float))
    middles = np.asarray((parts.base + parts.tip) / 2)  # (P, 3, T)
    far = np.linalg.norm(middles - np.asarray(cameras.centre)[0][None, :, None], axis=1)
    words, hues = -(-width // 32), _hues(len(far))
    images = np.full((len(states), height, width, 3), GROUND, np.uint8)
    masks = []
    for number in range(len(far)):
        one = slice(number, number + 1)
        own, place = jax.tree.map(lambda leaf, one=one: leaf[one], (flesh, parts))
        bits = body_bits(eyes, own, place, height, words, 1)
        masks.append(np.stack([unpack_bits(row, width)[0] for row in np.moveaxis(np.asarray(bits), -1, 0)]))
    for frame, order in enumerate(np.argsort(-far, axis=0).T):
        for number in order:
            images[frame][masks[number][frame]] = hues[number]
    return list(images)


def _hues(count: int) -> Image:
    """Light colours (count, 3), RGB, no two alike."""
    cv2 = opencv()
    turns = (np.arange(count) * 0.618) % 1 * 179
    tones = np.stack([turns, np.full(count, 150), np.where(np.arange(count) % 2, 255, 205)], -1)
    colours: Image = cv2.cvtColor(tones[None].astype(np.uint8), cv2.COLOR_HSV2RGB)[0]
    return colours


def _sights(images: list[Image]) -> Iterator[Sight]:
    """Features of the pictures."""
    background = background_from_plate(np.full_like(images[0], GROUND), _SETTINGS.background)
    for number, image in enumerate(images):
        yield Sight((extract(image, background, _SETTINGS, frame=number),), (image,))
