"""Jobs: an arm on rendered frames, tracked by the image cost of section 3.1."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.filters import covariance_scaled_filter
from poseppl.jobs import Job
from poseppl.motion.bodies.body import BodyInputs, load_builder
from poseppl.motion.geometry import Cameras, marker_positions
from poseppl.motion.io import CameraRecord
from poseppl.motion.rendering import Stage, build_setting
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl_papers.recordings import BUILT_IN
from poseppl_papers.runs import stacked
from poseppl_papers.sminchisescu_triggs.motions import moving
from poseppl_papers.sminchisescu_triggs.trackers import TRACKERS, search_settings
from poseppl_papers.sminchisescu_triggs.tracks import Estimate, follow, marker_error, walk_scales

SIZE, FOCAL, DISTANCE, HEIGHT = (640, 480), 1000.0, 3000.0, 1500.0
"""Camera: picture size and focal length in px, mm from the shoulder and above the floor."""
LEVELS, EDGES, FLOW, WEIGHT = (1.0, 2.5), 3.0, 4.0, 16.0
"""Parameters of the cost: levels of the pyramid, standard deviations (px) and weight."""
POSITION_STEP, ANGLE_STEP = 60.0, 1.5
"""Standard deviations of the walk in a second, mm and radians."""
_START = (15.0, 0.05)
_ARM = ("shoulder_r", "elbow_r", "wrist_r")


@dataclass(frozen=True)
class Pictures(Job):
    """Runs on rendered frames.

    Attributes:
        rate: Frames a second.
        seconds: How long the scene is.
        cluttered: Whether there is a room; otherwise what is not the person is black.
        tracker: One of TRACKERS that is robust and has all constraints.
        seeds: Seeds of motion and room.
    """

    rate: float
    seconds: float
    cluttered: bool
    tracker: str
    seeds: tuple[int, ...]

    @property
    def name(self) -> str:
        """Room and tracker."""
        return f"pictures-{self.rate:g}-{'cluttered' if self.cluttered else 'black'}-{self.tracker}"

    motion: ClassVar[str] = "arm"


class Filmed(NamedTuple):
    """Pictures of a person, the camera, the arm's body, its true states (T, 8), and its true places (T, 3, 3), mm."""

    pictures: list[NDArray[np.uint8]]
    cameras: Cameras
    body: Any
    states: Floats
    places: Floats


@lru_cache(maxsize=4)
def film(rate: float, seconds: float, cluttered: bool, seed: int) -> Filmed:
    """Render a person at rest whose right arm bends and rotates; the hand's own twist is not drawn, and is 0."""
    build = load_builder("poseppl_models.sminchisescu_triggs.body:superquadric_body")
    person, alone = build("full"), moving("arm", "arm", BUILT_IN, rate, seconds, seed)
    states, names = np.tile(np.asarray(person.rest, float), (len(alone.states), 1)), list(person.tree.marker_names)
    own = np.array(alone.states)
    for row, coordinate in enumerate(alone.body.tree.coordinates):
        if coordinate in person.tree.coordinates:
            states[:, person.tree.coordinates.index(coordinate)] = own[:, row]
        elif row >= 3:
            own[:, row] = 0.0
    markers = np.asarray(jax.vmap(partial(marker_positions, person.tree))(jnp.asarray(states, float)), np.float64)
    places = markers[:, [names.index(name) for name in _ARM]]
    own[:, :3] = places[:, 0]
    setting = build_setting(names, markers, clutter=cluttered, cameras=1, size=SIZE, seed=seed)
    record = _camera(places[:, 0].mean(0), float(markers[..., 2].min()))
    pictures = []
    with Stage(setting._replace(cameras=(record,))) as stage:
        for frame in range(len(markers)):
            stage.pose(frame)
            picture = stage.picture(0).copy()
            if not cluttered:
                picture[~stage.visible(0)] = 0
            pictures.append(picture)
    return Filmed(pictures, cameras_of_records((record,)), alone.body, own, places)


def _camera(target: Floats, floor: float) -> CameraRecord:
    """A camera that looks at a place from the person's front right."""
    centre = target + DISTANCE * np.array([0.6, 0.8, 0.0])
    centre[2] = floor + HEIGHT
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward])
    matrix = np.array([[FOCAL, 0, (SIZE[0] - 1) / 2], [0, FOCAL, (SIZE[1] - 1) / 2], [0, 0, 1.0]])
    return CameraRecord("camera_1", matrix, np.zeros(5), turn, -turn @ centre, SIZE)


def track_pictures(job: Pictures) -> dict[str, Any]:
    """Track an arm until the end, or until it is lost.

    Returns:
        As :func:`poseppl_papers.sminchisescu_triggs.tracks.track`; errors of elbow and wrist, relative to the shoulder.
    """
    return stacked([_track_one(job, seed) for seed in job.seeds])


def _track_one(job: Pictures, seed: int) -> dict[str, float]:
    filmed = film(job.rate, job.seconds, job.cluttered, seed)
    body = filmed.body
    rows = [body.tree.marker_names.index(name) for name in _ARM]
    program = load_builder("poseppl_models.sminchisescu_triggs.programs:image_programs")("arm")
    first = _inputs(job, filmed, 0, filmed.states[0])
    model = program.compile(first, {})
    observation = model.observe({name: np.zeros(site.shape) for name, site in model.observation_sites.items()})
    built = covariance_scaled_filter(model, 1, **search_settings(TRACKERS[job.tracker], "arm"))

    def frame_of(frame: int, previous: Any) -> tuple[Any, Any]:
        return observation, _inputs(job, filmed, frame, previous)

    def error(frame: int, found: Estimate) -> float:
        return marker_error(found.mean_of(partial(marker_positions, body.tree))[rows], filmed.places[frame])

    found = follow(built, seed, job.rate, len(filmed.pictures), frame_of, error, filmed.states[0])
    return found | {"ratio": float("nan")}


def _inputs(job: Pictures, filmed: Filmed, frame: int, previous: Any) -> BodyInputs:
    """Inputs of a frame, given the pose in the one before."""
    names = ("seen_in_images", "at_levels", "cost_noise")
    see, at_levels, noise = (load_builder(f"poseppl_models.sminchisescu_triggs.programs:{name}") for name in names)
    before = [filmed.pictures[frame - 1]] if frame else None
    seen = see([filmed.pictures[frame]], previous, before, levels=LEVELS)
    body = filmed.body
    start, step = walk_scales(body, _START, (POSITION_STEP, ANGLE_STEP), job.rate)
    spread = noise(edges=EDGES, flow=FLOW, weight=WEIGHT, levels=LEVELS)
    mean, scale, steps = (jnp.asarray(part, float) for part in (filmed.states[0], start, step))
    cameras = at_levels(filmed.cameras, LEVELS)
    return BodyInputs(cameras, spread, mean, scale, steps, body.tree, seen=seen, flesh=body.flesh)
