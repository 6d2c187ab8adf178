"""A person's proportions and shape from one picture, with the pose: initialisation as Sminchisescu and Triggs (2001) have it.

"Our initialization method also estimates the most important internal proportions and shape parameters, subject to a soft prior
based on standard humanoid dimensions" (section 2). The state has the joints within their limits and one site ``sizes``: the n
sizes whitened by the anthropometric prior (:mod:`poseppl_models.bodies.anthropometry`), so that the prior is a standard normal
and

    mm = mu_a + chol(Sigma_a) sizes,

which comes back as ``millimetres``. Data are joints marked in the picture, ``points``, and the contours of the parts, ``image``
(:mod:`poseppl_models.sminchisescu_triggs.cost`, without flow). Both sides have the same sizes. In one picture only the prior
distinguishes sizes from distance: the stature keeps its 3.9 %, proportions become known better. A search for modes under the
sites' bounds finds pose and sizes together, and the curvature there their uncertainty.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax import Array

from poseppl.arrays import Floats
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.batch_last import batch_last, batched_score
from poseppl.motion.geometry.kinematics import frames_of
from poseppl.motion.likelihoods import ProjectedMarkers
from poseppl.program import StateSpaceModel
from poseppl_models.bodies.anthropometry import INTERNAL, LIMBS, anthropometric_prior
from poseppl_models.bodies.limited_walk import limited_walk
from poseppl_models.bodies.random_walk import joint_sites
from poseppl_models.sminchisescu_triggs.body import Kind, SuperquadricBody, superquadric_body
from poseppl_models.sminchisescu_triggs.cost import CostNoise, CostSettings, ImageSeen, residuals_of
from poseppl_models.sminchisescu_triggs.likelihood import ImageResiduals
from poseppl_models.sminchisescu_triggs.superquadrics import part_axes

SHAPES = ("chest_width", "pelvis_width", "head_width", "upper_arm_width", "forearm_width", "thigh_width", "shank_width")
SIZES = (*INTERNAL, "thorax", "shoulder_side", *LIMBS, *SHAPES)
"""Sizes that are estimated: internal proportions, trunk, shoulders, limbs, and widths of the parts; ours."""
_CHANGE = 1e-3
"""Standard deviation of a size's change from frame to frame, in the prior's: a person's sizes stay."""
_CHUNK = 16


class SizeInputs(NamedTuple):
    """Inputs of a picture.

    Attributes:
        cameras: C cameras, px.
        marked: Standard deviation of the joints marked in it (C, markers), px.
        seen: Further observations, from :func:`poseppl_models.sminchisescu_triggs.programs.seen_in_images`.
        noise: Noise of the contours.
        start: Mean of the pose (d,): mm and radians.
        start_scale: Its standard deviations (d,).
        step_scale: Standard deviations of the walk (d,), of further pictures.
    """

    cameras: Cameras
    marked: Array
    seen: ImageSeen
    noise: CostNoise
    start: Array
    start_scale: Array
    step_scale: Array


@lru_cache(maxsize=8)
def size_programs(kind: Kind = "full", names: tuple[str, ...] = SIZES, *, contours: bool = True) -> StateSpaceModel:
    """Write the programs; their inputs are :class:`SizeInputs`.

    Args:
        kind: Which body.
        names: The sizes that are estimated; the others are those of the standard humanoid.
        contours: Whether contours are seen beside the joints.
    """
    prior = _prior(kind, names)
    body = prior.body
    spans = joint_sites(body.tree.coordinates)
    first, then = limited_walk(spans, body.limits, body.stabilisers)
    functions = _functions(kind, names)

    def initial(params: Any, inputs: SizeInputs) -> None:
        first(params, inputs)
        numpyro.sample("sizes", dist.Normal(jnp.zeros(len(names)), 1.0))

    def transition(params: Any, state: Mapping[str, Any], inputs: SizeInputs) -> None:
        then(params, state, inputs)
        numpyro.sample("sizes", dist.Normal(state["sizes"], _CHANGE))

    def observation(params: Any, state: Mapping[str, Any], inputs: SizeInputs) -> None:
        pose = jnp.concatenate([state[name] for name in spans])
        own = prior.sizes_of(state["sizes"])
        tree, _ = body.sized_in(body.tree, body.flesh, own)
        numpyro.sample("points", ProjectedMarkers(tree, inputs.cameras, pose, inputs.marked))
        if contours:
            both = jnp.concatenate([pose, state["sizes"]])
            numpyro.sample("image", ImageResiduals(*functions, both, (inputs.cameras, inputs.seen, inputs.noise)))
        numpyro.deterministic("millimetres", own[prior.place])

    return StateSpaceModel(initial, transition, observation)


class _Prior(NamedTuple):
    """The body, its sizes (S,), and the prior of those that are estimated: place (n,), mean (n,) and Cholesky factor (n, n)."""

    body: SuperquadricBody
    place: Floats
    mean: Floats
    root: Floats

    def sizes_of(self, white: Array) -> Array:
        """All sizes (S, ...), mm, from whitened ones (n, ...)."""
        own = jnp.asarray([*self.body.sizes.values()], white.dtype).reshape(-1, *(1,) * (white.ndim - 1))
        mean = jnp.asarray(self.mean, white.dtype).reshape(-1, *(1,) * (white.ndim - 1))
        found = mean + jnp.tensordot(jnp.asarray(self.root, white.dtype), white, 1, precision="highest")
        return jnp.broadcast_to(own, (len(own), *white.shape[1:])).at[self.place].set(found)


def _prior(kind: Kind, names: tuple[str, ...]) -> _Prior:
    body, (mean, covariance) = superquadric_body(kind), anthropometric_prior(names)
    return _Prior(
        body, np.array([list(body.sizes).index(name) for name in names]), mean, np.asarray(np.linalg.cholesky(covariance))
    )


@lru_cache(maxsize=8)
def _functions(kind: Kind, names: tuple[str, ...]) -> tuple[Any, Any, Any]:
    """Residuals (C, entries) of poses and sizes, Jacobian and rows of the curvature (C, entries, d + n), of single states."""
    prior, settings = _prior(kind, names), CostSettings()
    body = prior.body

    def residuals(both: Array, cameras: Cameras, seen: ImageSeen, noise: CostNoise, *, curved: bool = False) -> Array:
        split = body.tree.dimension
        still_tree, still_flesh = jax.tree.map(lambda leaf: leaf[..., None], (body.tree, body.flesh))
        tree, flesh = body.sized_in(still_tree, still_flesh, prior.sizes_of(both[split:]))
        own = part_axes(flesh, frames_of(tree, both[:split]))
        found: Array = residuals_of(settings, (tree, flesh, cameras, seen, noise), own, curved=curved)
        return found.reshape(len(found), -1, found.shape[-1])

    def jacobian(both: Array, *known: Any, curved: bool = False) -> Array:
        def along(row: Array) -> Array:
            slope: Array = jax.jvp(
                lambda x: residuals(x, *known, curved=curved), (both,), (jnp.broadcast_to(row[:, None], both.shape),)
            )[1]
            return slope

        return jnp.moveaxis(jax.vmap(along)(jnp.eye(both.shape[0], dtype=both.dtype)), 0, 2)

    slopes, curvature = (batch_last(partial(jacobian, curved=each), chunk=_CHUNK) for each in (False, True))
    return batched_score(residuals, chunk=_CHUNK), slopes, curvature
