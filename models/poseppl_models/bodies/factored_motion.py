"""A recorded walk as NumPyro programs: the factored-state hierarchical hidden Markov model.

Peursum, Venkatesh and West 2010, doi:10.1007/s11263-009-0205-5, Eqs. 7a to 7h and 26. A phase q decides how each of D rotations
x^d goes on, in B bins of a turn:

    q_t ~ C[q_(t-1)],
    x_t^d ~ A^d[q_t, x_(t-1)^d]  if e_t^d = 0,    x_t^d ~ A^d[q_t]  if e_t^d = 1.

The rotations are independent given the phase. The end flag e_t^d means that the phase has no successor of the bin, so that the
rotation enters the phase again. Eq. 26 has the previous phase in its index, which would use empty rows at the beginning of a
phase. Here the index is the phase that moves the rotation. The flag follows from (q_t, x_(t-1)), and is no site.

The first frame has q_1 ~ phi and x_1^d ~ varphi[q_1]. Heading u and position v are continuous:

    u_t ~ N(u_(t-1), s_u^2),    v_t ~ w N(v_(t-1), S_v) + (1 - w) N(v_(t-1) + dt R(u_t) m_q, S_v),

which is how Eqs. 7g and 7h are read here: a body stays where it is, or goes where it faces, with the mean velocity m of the
phase for the dt seconds since the last frame. The paper names the two weights of Eq. 7h, and gives neither their values nor the
second law. So heading and position do not depend on the frame rate. Phases and rotations do: a row of C or A is a step of one
frame at the rate of the recording, as in the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax import Array

from poseppl.motion.learned import FactoredMotion, FactoredTables, bin_angles, root_places
from poseppl.program import StateSpaceModel
from poseppl_models.bodies.learned_motion import Pose, SeenActivity
from poseppl_models.bodies.random_walk import Observe, see_points, see_silhouettes


def factored_motion(coordinates: Sequence[tuple[str, str]], observe: Observe) -> StateSpaceModel:
    """Write the programs of a body, sites ``phase``, ``bins``, ``heading`` () and ``position`` (3,).

    Args:
        coordinates: Joint and axis of each of the body's d coordinates; the root's position and turn about the vertical are
            continuous, the other D are in bins.
        observe: Observations of a pose (d,). Inputs have ``activity`` (:class:`FactoredTables`), and ``start``, ``start_scale``
            and ``step_scale`` (d,), mm and radians, of which position and heading are used, and ``seconds`` ().
    """
    places = np.array(root_places(coordinates))
    pose_of = pose_of_bins(coordinates)

    def initial(params: Any, inputs: Any) -> None:
        first_frame(inputs.activity)
        mean, scale = inputs.start[places], inputs.start_scale[places]
        numpyro.sample("heading", dist.Normal(mean[3], scale[3]))
        numpyro.sample("position", dist.Normal(mean[:3], scale[:3]).to_event(1))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        motion: FactoredTables = inputs.activity
        phase = next_frame(motion, state)
        scale = inputs.step_scale[places]
        heading = numpyro.sample("heading", dist.Normal(state["heading"], scale[3]))
        means = state["position"] + jnp.stack([jnp.zeros(3), turned(motion.velocities[phase] * inputs.seconds, heading)])
        ways = dist.Categorical(probs=jnp.stack([motion.stays, 1 - motion.stays]))
        numpyro.sample("position", dist.MixtureSameFamily(ways, dist.Normal(means, scale[:3]).to_event(1)))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        observe(params, pose_of(state, inputs.activity), inputs)

    return StateSpaceModel(initial, transition, observation)


def pose_of_bins(coordinates: Sequence[tuple[str, str]]) -> Any:
    """Write the pose (d,) of a state of :func:`factored_motion`, by its sites, and its tables."""
    places = root_places(coordinates)
    rotations = np.setdiff1d(np.arange(len(coordinates)), places)
    order = jnp.asarray(np.argsort(np.concatenate([places, rotations])))

    def pose(state: Any, motion: FactoredTables) -> Array:
        angles = bin_angles(state["bins"], motion.first_bins.shape[-1])
        parts = [state["position"], state["heading"][None], angles]
        return jnp.concatenate(parts)[order]

    return pose


def turned(step: Array, heading: Array) -> Array:
    """A step (3,) forwards, to the left and up, in the world; a heading of 0 faces along y."""
    sine, cosine = jnp.sin(heading), jnp.cos(heading)
    forwards, left, up = step
    return jnp.stack([-sine * forwards - cosine * left, cosine * forwards - sine * left, up])


def first_frame(motion: FactoredTables) -> None:
    """Sample ``phase`` and ``bins`` (D,) of the first frame."""
    phase = numpyro.sample("phase", dist.Categorical(probs=motion.first_phase))
    numpyro.sample("bins", dist.Categorical(probs=motion.first_bins[phase]))


def next_frame(motion: FactoredTables, state: dict[str, Any]) -> Array:
    """Sample ``phase``, which is returned, and ``bins`` (D,) after a state."""
    phase: Array = numpyro.sample("phase", dist.Categorical(probs=motion.phases[state["phase"]]))
    numpyro.sample("bins", NextBins(motion, phase, state["bins"]))
    return phase


class NextBins(dist.CategoricalProbs):  # type: ignore[misc]
    """The bins (D,) that follow others in a phase, of which neither a density nor a draw needs whole rows of the tables.

    For 10,000 particles these would be 30 million probabilities a frame. Cumulative sums are of the tables, and so are computed
    once for all particles.
    """

    def __init__(self, motion: FactoredTables, phase: Array, bins: Array):
        super().__init__(motion.successors(phase, bins), validate_args=False)
        self._motion, self._row = motion, (phase, jnp.arange(self.batch_shape[-1]), bins)

    def _of(self, entries: Array, steps: Array, value: Array) -> Array:
        """Numbers (..., D) of bins in the table of steps, or of entries where the rotation ends."""
        phase, rotation, _ = self._row
        ends = jnp.sum(self._motion.steps, -1) <= 0
        return jnp.where(ends[self._row], entries[phase, rotation, value], steps[(*self._row, value)])

    def log_prob(self, value: Array) -> Array:
        """Log-probabilities (..., D) of bins."""
        return jnp.log(self._of(self._motion.entries, self._motion.steps, value))

    def sample(self, key: Array, sample_shape: tuple[int, ...] = ()) -> Array:
        """Draw bins (..., D): the first whose cumulative probability is above a uniform number, by bisection."""
        count = self._motion.entries.shape[-1]
        until = jnp.triu(jnp.ones((count, count)))  # so that cumulative sums are products
        entries, steps = self._motion.entries @ until, self._motion.steps @ until
        total = self._of(entries, steps, jnp.full(self.batch_shape, count - 1))
        wanted = jax.random.uniform(key, (*sample_shape, *self.batch_shape), total.dtype) * total
        below = jnp.zeros(wanted.shape, jnp.int32)
        for width in (1 << power for power in reversed(range((count - 1).bit_length()))):
            last = below + (width - 1)
            passes = (last < count - 1) & (self._of(entries, steps, jnp.minimum(last, count - 1)) <= wanted)
            below = jnp.where(passes, below + width, below)
        return below


def seen_walk(
    motion: FactoredMotion,
    coordinates: tuple[tuple[str, str], ...],
    start: Any,
    start_scale: Any,
    *,
    silhouettes: bool = False,
) -> SeenActivity:
    """Build what a tracker takes of a recorded walk.

    Args:
        motion: The walk.
        coordinates: Joint and axis of each of the body's d coordinates.
        start: Pose (d,) that the first one is near.
        start_scale: How near, standard deviations (d,).
        silhouettes: Whether the person is seen as silhouettes; as points otherwise.
    """
    rotations = np.setdiff1d(np.arange(len(coordinates)), root_places(coordinates))
    tables = motion.tables.starting_from(jnp.asarray(start)[rotations], jnp.asarray(start_scale)[rotations])
    return SeenActivity(*_seen(coordinates, see_silhouettes if silhouettes else see_points), None, tables)


@lru_cache(maxsize=8)
def _seen(coordinates: tuple[tuple[str, str], ...], observe: Observe) -> tuple[StateSpaceModel, Pose]:
    """The programs, and the pose of their states; the same objects again, so that nothing is compiled twice."""
    return factored_motion(coordinates, observe), pose_of_bins(coordinates)
