"""Systems of Choo and Fleet 2001: three trackers with the settings of Table 1, their recordings, and what all jobs share.

The published step sizes (10.3, 4.0 and 3.0) belong to estimates of the curvature in Eq. 17 that the paper does not give: with
our Gauss-Newton curvature no epsilon above 2 is stable. Ours are fixed, as theirs are, and such that with the paper's L the
estimates vary least from run to run; the full body then rejects some 5 %, for with L = 40 chains begin to stick at 10 %. With
shorter trajectories the paper's rule of 15 % (section 7.5) is a good one. The tuning curves show it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from poseppl.arrays import Floats
from poseppl.jobs import Job
from poseppl.kernels import HMCSettings
from poseppl.motion.bodies.body import Body, load_builder
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.geometry import Cameras, paper_camera, project
from poseppl.motion.io import read_motion
from poseppl.motion.recordings.subjects import WALK_FRAMES, recorded_subject, walking_subject
from poseppl.motion.tracking import Scene, make_problem
from poseppl.motion.tracking.placing import cameras_around
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.problem import Problem
from poseppl.motion.tracking.scene import noise_of
from poseppl.motion.tracking.walk import step_scales
from poseppl.particles.stacks import tree_index
from poseppl.program import Observation
from poseppl.runs.frame_sequence import frame_inputs
from poseppl_papers.recordings import Recording

UPDATES = (8, 16, 32, 64, 128, 256, 512)
"""R of all rows of Table 1."""
NUM_WARMUP = 6
RATE = 30.0
"""Frames a second of the sequences, which the paper does not tell."""


class System(NamedTuple):
    """A tracker and its row of Table 1.

    Attributes:
        name: "arm", "lower_body" or "full_body".
        model: Builder of the body.
        dimension: d.
        num_particles: The smallest number of particles; it doubles six times.
        num_chains: M.
        num_leapfrog: L.
        step_size: Ours.
    """

    name: str
    model: str
    dimension: int
    num_particles: int
    num_chains: int
    num_leapfrog: int
    step_size: float

    def hmc(self, num_updates: int) -> HMCSettings:
        """The chains of the paper's row."""
        return HMCSettings(num_updates, self.num_leapfrog, min(NUM_WARMUP, num_updates - 1), self.step_size, None)


_MODELS = "poseppl_models.bodies.choo_fleet"
SYSTEMS = {
    system.name: system
    for system in (
        System("arm", f"{_MODELS}:arm", 4, 320, 4, 2, 0.7),
        System("lower_body", f"{_MODELS}:lower_body", 10, 5_700, 8, 20, 0.3),
        System("full_body", f"{_MODELS}:full_body", 28, 27_000, 10, 40, 0.25),
    )
}


def coordinate_names(system: str) -> list[str]:
    """Names of a tracker's d coordinates, such as "pelvis.X"."""
    body = load_builder(SYSTEMS[system].model)(None)
    return [".".join(body.tree.coordinates[index]) for index in body.free_coordinates]


SIMULATED = Recording("simulated")
"""Drawn from the model itself: here alone must intervals cover as often as they say."""
_SIMULATED_FRAMES = 60


class Stage(NamedTuple):
    """A subject before the camera: all that is known without noise.

    Attributes:
        body: The body of the system, with the subject's limbs.
        cameras: One camera at 5 m, at which the noise of 0.003 is 3 % of an upright spine's image.
        states: (T, 28) mm and radians.
        markers: (T, K, 3) mm: as recorded, and where the recording has none, the body's own.
        points: (T, 1, K, 2) their images.
        noise: (1, K) standard deviation of the image noise.
        residual: Mean distance of recorded markers from the body's, mm; None where there is none.
    """

    body: Body
    cameras: Cameras
    states: Floats
    markers: Floats
    points: Floats
    noise: Floats
    residual: float | None


def stage_of(recording: Recording, system: str, run: int = 0) -> Stage:
    """Place a subject before the camera; each run of :data:`SIMULATED` has a motion of its own.

    Raises:
        InputError: The recording cannot be used.
    """
    return _simulated(SYSTEMS[system], run) if recording == SIMULATED else _recorded(recording, SYSTEMS[system])


@lru_cache(maxsize=16)
def _recorded(recording: Recording, system: System) -> Stage:
    subject = _subject(recording)
    body = load_builder(system.model)(subject.body.lengths)
    cameras = cameras_around(subject)
    markers = subject._replace(body=body).complete_markers()
    return _staged(body, cameras, subject.states, markers, subject.residual)


@lru_cache(maxsize=64)
def _simulated(system: System, run: int) -> Stage:
    """The random walk of the model itself, which starts from standing."""
    body = load_builder(system.model)(None)
    free = list(body.free_coordinates)
    steps = np.random.default_rng((2001, run)).standard_normal((_SIMULATED_FRAMES, len(free)))
    states = np.tile(np.asarray(body.rest, np.float64), (1 + _SIMULATED_FRAMES, 1))
    states[1:, free] += np.cumsum(steps * step_scales(body, body.params)[free], axis=0)
    return _staged(body, paper_camera((0.0, -5000.0, 1000.0)), states, body.places(states), None)


def _staged(body: Body, cameras: Cameras, states: Floats, markers: Floats, residual: float | None) -> Stage:
    points = np.moveaxis(np.asarray(project(cameras, jnp.asarray(markers)), np.float64), 0, 1)
    return Stage(body, cameras, states, markers, points, noise_of(body, cameras, None), residual)


@lru_cache(maxsize=4)
def _subject(recording: Recording) -> MovingSubject:
    if recording.path is None:
        return walking_subject(frames=f"0:{WALK_FRAMES}", rate=RATE)
    motion = read_motion(recording.path, recording.skeleton)
    step = max(1, round(motion.rate / RATE))
    return recorded_subject(recording.path, recording.skeleton, frames=f"::{step}")


def single_frames(stage: Stage) -> tuple[int, ...]:
    """Three widely spaced frames."""
    return tuple(int(round(share * (len(stage.states) - 1))) for share in (0.25, 0.5, 0.75))


def noisy_points(stage: Stage, frames: slice, run: int) -> Floats:
    """Points (T, 1, K, 2) of some frames in one run; a frame's noise depends on its number and the run alone."""
    numbers = range(len(stage.points))[frames]
    noise = [np.random.default_rng((run, number)).standard_normal(stage.points.shape[1:]) for number in numbers]
    return np.asarray(stage.points[frames] + stage.noise[..., None] * np.array(noise))


class Frame(NamedTuple):
    """One frame alone, whose prior is a step of the random walk from the true state of the frame before.

    Attributes:
        stage: The sequence that it is of.
        number: Its index.
        problem: Its problem, without noise.
    """

    stage: Stage
    number: int
    problem: Problem

    @property
    def inputs(self) -> Any:
        """The inputs of the model."""
        return frame_inputs(self.problem.inputs, 0)

    def observe(self, run: int) -> Observation:
        """The data in one run."""
        points = noisy_points(self.stage, slice(self.number, self.number + 1), run)
        return tree_index(self.problem.model.observe({"points": points}), 0)


def frame_of(recording: Recording, system: str, number: int) -> Frame:
    """The problem of one frame."""
    stage = stage_of(recording, system)
    scene = _scene(stage, slice(number, number + 1), stage.points[number : number + 1])
    return Frame(stage, number, make_problem(scene, start=stage.states[number - 1]))


def pose_sequence(stage: Stage, frames: slice, points: Floats) -> Problem:
    """The problem of a sequence, whose prior is a step of the random walk from the true state of the frame before."""
    return make_problem(_scene(stage, frames, points), start=stage.states[frames.start - 1])


def _scene(stage: Stage, frames: slice, points: Floats) -> Scene[PointData]:
    numbers = np.arange(len(stage.states))[frames]
    return Scene(
        stage.body,
        stage.cameras,
        ("camera",),
        PointData(points, stage.noise),
        numbers,
        RATE,
        "",
        stage.states[frames],
        stage.markers[frames],
        stage.residual,
    )


@dataclass(frozen=True)
class TrackerJob(Job):
    """A job of one tracker.

    Attributes:
        recording: Recording of the person that is seen.
        system: The tracker.
    """

    recording: Recording
    system: str

    @property
    def row(self) -> System:
        """The tracker and its row of Table 1."""
        return SYSTEMS[self.system]
