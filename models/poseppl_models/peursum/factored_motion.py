r"""A factored-state hierarchical hidden Markov model of one activity (Peursum, Venkatesh and West 2010, section 3.3).

doi:10.1007/s11263-009-0205-5, Eqs. 7a to 7h and 26. A phase q decides how each of D rotations x^d goes on, in B bins of a turn:

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
from typing import Any

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax import Array

from poseppl.motion.learned import FactoredTables, bin_angles, root_places
from poseppl.program import StateSpaceModel
from poseppl_models.bodies.random_walk import Observe


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
    numpyro.sample("bins", dist.Categorical(probs=motion.successors(phase, state["bins"])))
    return phase
