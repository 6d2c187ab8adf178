"""A filter's particles over a walk, as the smoothers of the paper take them, and the paper's error of a posture (section 5.1).

A motion without phases, such as the generic one, has one phase. The first pose is the true one for generic motions. The learned
motion finds it with :data:`FIRST_PARTICLES` particles on the first frame.

The mean posture is the weighted mean of positions and joint angles, not of places; its virtual markers stand against the true
ones (Sigal and Black 2006, Eqs. 3 to 6). The hips, the upper ends of the legs, are left out: the paper found no points on its
body that matched them well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike

from poseppl.arrays import Floats, Integers
from poseppl.compilation import jit
from poseppl.filters import Filter, particle_filter
from poseppl.motion.geometry import KinematicTree, marker_positions
from poseppl.motion.learned import root_places
from poseppl.motion.learned.angles import mean_angle
from poseppl.motion.learned.factored_tables import NUM_BINS, bins_of
from poseppl.motion.tracking.marker_errors import VIRTUAL_MARKERS, virtual_markers
from poseppl_papers.images.systems import Problem
from poseppl_papers.images.tracking import first_state
from poseppl_papers.peursum.factored_draws import Particles
from poseppl_papers.runs import finished

FIRST_PARTICLES = 20_000


class Track(NamedTuple):
    """N particles of T frames.

    Attributes:
        states: The filter's (T, N, d').
        poses: (T, N, d), mm and radians.
        log_weights: Normalised (T, N).
        ancestors: Ancestor of each in the previous frame (T, N); its own index if the filter does not report it.
        particles: Phases (T, N), bins (T, N, D) and roots (T, N, 4).
        rotations: (T, N, D), radians.
        seconds: Seconds of each frame (T,).
    """

    states: Array
    poses: Array
    log_weights: Array
    ancestors: Integers
    particles: Particles
    rotations: Array
    seconds: Floats

    @property
    def ess_share(self) -> Floats:
        """ESS / N of each frame (T,)."""
        weights = np.exp(np.asarray(self.log_weights, np.float64))
        return np.asarray(1 / np.square(weights).sum(1) / weights.shape[1])

    def survivors(self, frames: int = 3) -> Floats:
        """How many particles have descendants so many frames later (T - frames,)."""
        found = []
        for last in range(frames, len(self.ancestors)):
            alive = self.ancestors[last]
            for frame in range(last - 1, last - frames, -1):
                alive = self.ancestors[frame][alive]
            found.append(float(len(np.unique(alive))))
        return np.array(found)


def run_track(problem: Problem, filter: Filter, step: Callable[..., Any], seed: int) -> Track:
    """Run a filter over all frames of a problem.

    Args:
        problem: A system before a scene.
        filter: The filter.
        step: Its step, compiled.
        seed: Seed of the run.
    """
    key, data = jax.random.key(seed + 1), problem.model.observe({})
    finds = problem.system.learned is not None
    state = _found(problem, filter, seed) if finds else first_state(problem, filter, seed)
    rows = [(state, np.arange(len(state.particles)), np.nan)] if finds else []
    for number in range(len(rows), len(problem.frames)):
        (state, info), seconds = finished(step, jax.random.fold_in(key, number), state, data, problem.frames[number])
        rows.append((state, np.asarray(info.ancestors), seconds))
    states = jnp.stack([state.particles for state, _, _ in rows])
    log_weights = jax.nn.log_softmax(jnp.stack([state.log_weights for state, _, _ in rows]), -1)
    poses = jnp.stack([problem.poses(own, number) for number, own in enumerate(states)])
    count = states.shape[1]
    ancestors = np.stack([found if len(found) == count else np.arange(count) for _, found, _ in rows])
    places = root_places(problem.system.tree.coordinates)
    rotations = jnp.delete(poses, np.array(places), axis=-1)
    phases = states[..., 0].astype(int) if finds else jnp.zeros(states.shape[:2], int)
    particles = Particles(phases, jnp.asarray(bins_of(rotations, NUM_BINS)), poses[..., np.array(places)])
    return Track(states, poses, log_weights, ancestors, particles, rotations, np.array([each for _, _, each in rows]))


def posture_of(tree: Any, roots: Array, rotations: Array) -> Floats:
    """Poses (T, d) of roots (T, 4) and rotations (T, D)."""
    places = root_places(tree.coordinates)
    others = np.setdiff1d(np.arange(tree.dimension), places)
    poses = np.empty((len(roots), tree.dimension))
    poses[:, places], poses[:, others] = np.asarray(roots), np.asarray(rotations)
    return poses


def _found(problem: Problem, filter: Filter, seed: int) -> Any:
    """The particles of the first frame: many, of which as many as the filter has are drawn by weight."""
    key_first, key_chosen = jax.random.split(jax.random.key(seed))
    data, inputs = problem.model.observe({}), problem.frames[0]
    first = particle_filter(problem.model, num_particles=FIRST_PARTICLES)
    state, _ = _started(first)(key_first, data, inputs)
    count = len(jax.eval_shape(filter.init, key_first, data, inputs)[0].particles)
    chosen = jax.random.categorical(key_chosen, state.log_weights, shape=(count,))
    return state._replace(particles=state.particles[chosen], log_weights=jnp.full(count, -np.log(count)))


@lru_cache(maxsize=2)
def _started(filter: Filter) -> Callable[..., Any]:
    """The filter's first step, compiled once."""
    return jit(filter.init)


def frames_of(particles: Particles) -> Sequence[Particles]:
    """Each frame's, of T frames'."""
    return [jax.tree.map(lambda leaf, t=t: leaf[t], particles) for t in range(len(particles.phases))]


LEFT_OUT = ("hip_l", "hip_r")
_COMPARED = [number for number, name in enumerate(VIRTUAL_MARKERS) if name not in LEFT_OUT]


def mean_posture(states: ArrayLike, weights: ArrayLike) -> Floats:
    """The weighted mean of poses: of positions, and of angles as directions, so that whole turns do not matter.

    Args:
        states: (N, d), three positions (mm) and then angles (radians).
        weights: (N,), which need not add up to 1; the state of a particle of no weight does not matter.

    Returns:
        The mean (d,).
    """
    poses, shares = np.asarray(states, np.float64), np.asarray(weights, np.float64)
    poses, shares = poses[shares > 0], shares[shares > 0]
    return np.concatenate([np.average(poses[:, :3], 0, shares), mean_angle(poses[:, 3:], shares)])


def posture_error(tree: KinematicTree, states: ArrayLike, weights: ArrayLike, truth: ArrayLike) -> float:
    """Mean distance of the mean posture from the truth over thirteen joints, mm.

    Args:
        tree: The body.
        states: As :func:`mean_posture` takes them.
        weights: Likewise.
        truth: The fifteen virtual markers (15, 3), mm.
    """
    return float(np.linalg.norm(_offsets(tree, states, weights, truth), axis=-1)[_COMPARED].mean())


def posture_squares(tree: KinematicTree, states: ArrayLike, weights: ArrayLike, truth: ArrayLike) -> Floats:
    """Mean squared distance of the mean posture from the truth over all fifteen markers, mm^2 (Table 3).

    Args:
        tree: The body.
        states: As :func:`mean_posture` takes them.
        weights: Likewise.
        truth: The fifteen virtual markers (15, 3), mm.

    Returns:
        Shape (2,): as they are, and with the pelvises together.
    """
    apart = _offsets(tree, states, weights, truth)
    return np.array([np.square(each).sum(-1).mean() for each in (apart, apart - apart[:1])])


def _offsets(tree: KinematicTree, states: ArrayLike, weights: ArrayLike, truth: ArrayLike) -> Floats:
    """Offsets (15, 3), mm, of the mean posture's virtual markers from the truth."""
    places = _places(tree, jnp.asarray(mean_posture(states, weights), float))
    return np.asarray(virtual_markers(tree.marker_names, places) - np.asarray(truth, np.float64))


@jit
def _places(tree: Any, state: Array) -> Array:
    return marker_positions(tree, state)
