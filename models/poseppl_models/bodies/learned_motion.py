r"""A learned activity as NumPyro programs (Darby, Li and Costen 2008, doi:10.1109/AFGR.2008.4813348, sections 4 to 6).

    s_t ~ A[s_(t-1)],    f_t ~ N(mu_s, Sigma_s),    w_t ~ N(w_(t-1), step_scale^2),    pose = (w, mean + Phi f)

The phase s is finite, the features f (eta,) and the free coordinates w are real: sites `phase` and `features` beside those of
the free joints (:func:`learned_motion`). Beyond the paper, whose poses lie on the components, the learned angles may stay from
them as far and for as long as those of the recordings did: with psi and rho of the model, site `residual` is

    e_t ~ N(rho e_(t-1), (1 - rho^2) psi^2),    pose = (w, mean + Phi f + e).

The motion need not be the activity at all. :meth:`Activity.with_other_motion` adds a phase that stands for anything
else: in it w walks at random, and so do the angles, which come back to their mean within a memory; on the way back to the
activity f and e are drawn as at first. The probability of that phase therefore shows when the motion is another one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax import Array

from poseppl.arrays import Integers
from poseppl.compilation import jit
from poseppl.motion.learned import MotionModel
from poseppl.motion.learned.angles import wrapped
from poseppl.program import StateSpaceModel
from poseppl_models.bodies.random_walk import Observe, joint_sites, see_points, see_silhouettes

UNTIL_OTHER, OTHER_LASTS = 10.0, 1.0
"""Mean seconds of an activity before other motion begins, and of that; ours."""
OTHER_MEMORY = 0.3
"""Seconds in which the angles of other motion come back to their mean, by a factor of e; ours."""
_STILL = 5.5e-3
"""Standard deviation of the features' walk in other motion, over the square root of a second: 0.001 in a frame at 30 Hz."""


class OtherMotion(NamedTuple):
    """Motion other than the activity.

    Attributes:
        walk_scale: Standard deviations of a step of each of the body's coordinates (d,).
        kept: Share of the angles' distance from their mean that remains in the next frame, ().
    """

    walk_scale: Array
    kept: Array


class Activity(NamedTuple):
    """A learned activity as arguments of programs: arrays, so that all activities of one size share what is compiled.

    Attributes:
        initial: Probabilities of the first phase (N,).
        transition: Probabilities of the next one (N, N).
        means: mu (N, eta).
        scales: Lower square roots of Sigma (N, eta, eta).
        centre: Mean angles (L,), radians.
        components: Phi (L, eta).
        residual_scale: psi (L,), radians.
        residual_kept: rho (L,).
        other: Parameters of the last phase, which is then other motion; None without such a phase.
    """

    initial: Array
    transition: Array
    means: Array
    scales: Array
    centre: Array
    components: Array
    residual_scale: Array
    residual_kept: Array
    other: OtherMotion | None = None

    @classmethod
    def of_model(cls, model: MotionModel, person: str | None = None, *, every: int = 1) -> Activity:
        """The activity as arrays.

        Args:
            model: The model.
            person: One of those that it was learned from; None is somebody unknown, whose mean differs as theirs do.
            every: Frames of the model that are one of the program's.
        """
        scale, kept = model.residuals(person)
        return cls(
            jnp.asarray(model.initial, float),
            jnp.asarray(np.linalg.matrix_power(model.transition, every), float),
            jnp.asarray(model.means, float),
            jnp.linalg.cholesky(jnp.asarray(model.covariances, float)),
            jnp.asarray(model.mean_angles(person), float),
            jnp.asarray(model.components, float),
            jnp.asarray(scale, float),
            jnp.asarray(kept**every, float),
        )

    @property
    def num_learned(self) -> int:
        """Number of phases of the activity itself."""
        return len(self.means) - (self.other is not None)

    def starting_from(self, angles: Array, scale: Array) -> Activity:
        """The activity of somebody whose first learned angles (L,) are known within standard deviations (L,), or a scalar."""
        count = self.num_learned
        spread = self.scales[:count] @ jnp.swapaxes(self.scales[:count], 1, 2)
        noise = jnp.diag(jnp.square(self.residual_scale) + jnp.square(scale))
        covariances = self.components @ spread @ self.components.T + noise
        means = self.centre + self.means[:count] @ self.components.T
        normal = dist.MultivariateNormal(means, covariances, validate_args=False)  # a dozen small programs
        log_density = normal.log_prob(means + wrapped(angles - means))
        own = self.initial[:count]
        first = jnp.sum(own) * jax.nn.softmax(jnp.log(own) + log_density)
        return self._replace(initial=self.initial.at[:count].set(first))

    def with_other_motion(
        self,
        walk_scale: Array,
        seconds: float,
        *,
        until: float = UNTIL_OTHER,
        lasting: float = OTHER_LASTS,
        memory: float = OTHER_MEMORY,
    ) -> Activity:
        """The activity with one more phase, the last, in which the pose walks at random around the mean of the activity.

        Args:
            walk_scale: Standard deviations (d,) of the body's coordinates in a frame of it.
            seconds: From a frame to the next.
            until: Mean seconds of the activity before other motion begins.
            lasting: Mean seconds of other motion.
            memory: Seconds in which its angles come back to their mean, by a factor of e.
        """
        begins, ends = (-jnp.expm1(-seconds / mean) for mean in (until, lasting))
        share = lasting / (until + lasting)
        back = jnp.append(ends * self.initial, 1 - ends)
        transition = jnp.vstack([jnp.column_stack([(1 - begins) * self.transition, jnp.full(len(self.means), begins)]), back])
        still = _STILL * jnp.sqrt(seconds) * jnp.eye(self.means.shape[1])
        return self._replace(
            initial=jnp.append((1 - share) * self.initial, share),
            transition=transition,
            means=jnp.vstack([self.means, self.initial @ self.means]),
            scales=jnp.concatenate([self.scales, still[None]]),
            other=OtherMotion(jnp.asarray(walk_scale, float), jnp.exp(-seconds / memory)),
        )

    def is_other(self, phase: Any) -> Array:
        """Whether a phase is other motion."""
        return jnp.asarray(phase) >= self.num_learned

    def sample(self, probabilities: Array, before: Array | None = None) -> tuple[Array, Array]:
        """Sample the sites ``phase`` and ``features`` of a frame; features `before` (eta,) last in other motion."""
        phase = numpyro.sample("phase", dist.Categorical(probs=probabilities))
        mean = self.means[phase]
        if self.other is not None and before is not None:
            mean = jnp.where(self.is_other(phase), mean + self.other.kept * (before - mean), mean)
        emission = dist.MultivariateNormal(mean, scale_tril=self.scales[phase])
        return phase, numpyro.sample("features", emission)

    def first_residual(self, phase: Array, start: Array, start_scale: Array) -> tuple[Array, Array]:
        """Mean and standard deviations (L,) of the first residual; other motion starts from angles (L,) as they are known."""
        if self.other is None:
            return jnp.zeros_like(self.centre), self.residual_scale
        other = self.is_other(phase)
        apart = wrapped(start - self.angles(self.means[-1]))
        return jnp.where(other, apart, 0.0), jnp.where(other, start_scale, self.residual_scale)

    def next_residual(self, state: Mapping[str, Any], phase: Array, learned: Integers) -> tuple[Array, Array]:
        """Mean and standard deviations (L,) of the residual in a phase, after a state; `learned` (L,) are its places."""
        own, kept = state["residual"], self.residual_kept
        left = self.residual_scale * jnp.sqrt(1 - kept**2)
        if self.other is None:
            return kept * own, left
        other, returns = self.is_other(phase), self.is_other(state["phase"])
        mean = jnp.where(other, self.other.kept * own, jnp.where(returns, 0.0, kept * own))
        return mean, jnp.where(other, self.other.walk_scale[learned], jnp.where(returns, self.residual_scale, left))

    def angles(self, features: Array) -> Array:
        """Learned angles (L,) of features (eta,)."""
        return self.centre + self.components @ features


Pose = Callable[[Mapping[str, Any], Any], Array]
"""From the sites of a state, and the activity, to the pose (d,)."""


def learned_pose(coordinates: Sequence[tuple[str, str]], learned: Sequence[int]) -> Pose:
    """Write the pose (d,) of a state of :func:`learned_motion`, by its sites, and its activity; arguments as there."""
    free = np.setdiff1d(np.arange(len(coordinates)), learned)
    spans = joint_sites([coordinates[index] for index in free])
    order = jnp.asarray(np.argsort(np.concatenate([free, np.asarray(learned, int)])))

    def pose(state: Mapping[str, Any], activity: Activity) -> Array:
        angles = activity.angles(state["features"])
        own = angles + state["residual"] if "residual" in state else angles
        return jnp.concatenate([*(state[name] for name in spans), own])[order]

    return pose


def learned_motion(
    coordinates: Sequence[tuple[str, str]], learned: Sequence[int], observe: Observe, *, residual: bool = True
) -> StateSpaceModel:
    """Write the programs of a body that does what was learned.

    Args:
        coordinates: Joint and axis of each of the body's d coordinates.
        learned: Indices of those that the activity moves.
        observe: Program of the data of a pose (d,). Inputs have ``activity`` (:class:`Activity`), and for the free coordinates
            ``start``, ``start_scale`` and ``step_scale``, each (d,), as in
            :func:`poseppl_models.bodies.random_walk.random_walk`.
        residual: Whether angles stay from the components; without it they lie on them, as in the paper.
    """
    free, angles = np.setdiff1d(np.arange(len(coordinates)), learned), np.asarray(learned, int)
    spans = joint_sites([coordinates[index] for index in free])
    pose_of = learned_pose(coordinates, learned)

    def initial(params: Any, inputs: Any) -> None:
        activity: Activity = inputs.activity
        phase, _ = activity.sample(activity.initial)
        for name, span in spans.items():
            numpyro.sample(name, dist.Normal(inputs.start[free[span]], inputs.start_scale[free[span]]))
        if residual:
            own = inputs.start[angles], inputs.start_scale[angles]
            numpyro.sample("residual", dist.Normal(*activity.first_residual(phase, *own)))

    def transition(params: Any, state: dict[str, Any], inputs: Any) -> None:
        activity: Activity = inputs.activity
        phase, _ = activity.sample(activity.transition[state["phase"]], state["features"])
        walk = inputs.step_scale
        if activity.other is not None:
            walk = jnp.where(activity.is_other(phase), activity.other.walk_scale, walk)
        for name, span in spans.items():
            numpyro.sample(name, dist.Normal(state[name], walk[free[span]]))
        if residual:
            numpyro.sample("residual", dist.Normal(*activity.next_residual(state, phase, angles)))

    def observation(params: Any, state: dict[str, Any], inputs: Any) -> None:
        observe(params, pose_of(state, inputs.activity), inputs)

    return StateSpaceModel(initial, transition, observation)


class SeenActivity(NamedTuple):
    """Programs of a learned activity that is seen in cameras.

    Attributes:
        program: The programs; inputs are those of a body, its ``activity`` among them.
        pose: From the sites of a state, and the activity, to the pose (d,).
        follows: From the same to whether it is of the activity, 1, or of other motion, 0; None if there is no other.
        activity: The activity, with its given start.
    """

    program: StateSpaceModel
    pose: Pose
    follows: Pose | None
    activity: Any


_with_other_motion = jit(Activity.with_other_motion)


def seen_activity(
    model: MotionModel,
    coordinates: tuple[tuple[str, str], ...],
    every: int,
    start: Any,
    start_scale: Any,
    walk_scale: Any = None,
    *,
    silhouettes: bool = False,
) -> SeenActivity:
    """Build what a tracker takes of a learned activity of an unknown person.

    Args:
        model: The model.
        coordinates: Joint and axis of each of the body's d coordinates.
        every: Frames of the model that are one of the tracker's.
        start: Pose (d,) that the first one is near.
        start_scale: How near, standard deviations (d,).
        walk_scale: Standard deviations (d,) of a frame of other motion; None if there is none.
        silhouettes: Whether the person is seen as silhouettes; as points otherwise.
    """
    learned = tuple(model.learned.tolist())
    own = jnp.asarray(start)[model.learned], jnp.asarray(start_scale)[model.learned]
    activity = Activity.of_model(model, every=every)
    if walk_scale is not None:
        activity = _with_other_motion(activity, walk_scale, every / model.rate)
    program, pose, follows = _seen(coordinates, learned, see_silhouettes if silhouettes else see_points)
    return SeenActivity(program, pose, None if walk_scale is None else follows, activity.starting_from(*own))


@lru_cache(maxsize=8)
def _seen(
    coordinates: tuple[tuple[str, str], ...], learned: tuple[int, ...], observe: Observe
) -> tuple[StateSpaceModel, Pose, Pose]:
    """The programs, and functions of their states; the same objects again, so that nothing is compiled twice."""

    def follows(state: Mapping[str, Any], activity: Activity) -> Array:
        return 1.0 - activity.is_other(state["phase"])

    return learned_motion(coordinates, learned, observe), learned_pose(coordinates, learned), follows
