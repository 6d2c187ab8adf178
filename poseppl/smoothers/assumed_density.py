"""The backward pass of assumed density filtering: Rauch-Tung-Striebel smoothing between the Gaussians of a filter's particles.

N(m_t, P_t) are the moments of the particles of any filter that keeps to one mode, chiefly
:mod:`poseppl.filters.assumed_density`, whose own idea of the past they are; the pass is that of
:mod:`poseppl.smoothers.rauch_tung_striebel`. Observations are not used again, because the filter's particles contain their
information: they may have any nonlinearity. The transition is linearised. For a linear Gaussian model it is exact up to the
Monte Carlo error of the moments.

If a posterior is skewed, such as that of the distance of a person from a single camera, its mode is not its mean. Laplace's
approximation is then biased; this smoother is not (``studies/one_camera.py``).
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least, check_choice
from poseppl.gaussians.gaussian import Gaussian
from poseppl.gaussians.linearisation import Method
from poseppl.particles.stacks import prepend, tree_index
from poseppl.particles.weights import weighted_covariance, weighted_mean
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.smoothers.base import History, Smoother
from poseppl.smoothers.rauch_tung_striebel import ForwardPass, gaussian_smoother, predict_with_gain


@memoized_builder
def assumed_density_smoother(model: CompiledModel, *, num_draws: int = 1000, linearisation: Method = "first-order") -> Smoother:
    """The backward pass of assumed density filtering, between the Gaussians of the filter's particles: fast, of one mode.

    Args:
        model: The compiled model, its transition with Gaussian moments; the filter has many more particles than the state
            coordinates.
        num_draws: Trajectories to draw.
        linearisation: Linearisation of the transition: "first-order", "unscented" or "gauss-hermite" (up to 6 coordinates).

    Raises:
        ValueError: A number below 1 or an unknown linearisation.
    """
    check_at_least(1, num_draws=num_draws)
    check_choice(Method, linearisation=linearisation)

    def forward(history: History, observations: Observation, inputs: Any) -> ForwardPass:
        return _forward(model, history, inputs, linearisation)

    return gaussian_smoother(forward, num_draws, evaluations=(1.0, 0.0))


def _forward(model: CompiledModel, history: History, inputs: Any, method: Method) -> ForwardPass:
    """The filter's Gaussians, and what is predicted from each."""
    means, covariances = (jax.vmap(of)(history.particles, history.log_weights) for of in (weighted_mean, weighted_covariance))
    filtered = Gaussian(means, covariances)

    def advance(before: Gaussian, inputs: Any) -> tuple[Gaussian, Array, Array]:
        return predict_with_gain(model, before, before, inputs, method)

    predicted, gains, left = jax.vmap(advance)(tree_index(filtered, slice(-1)), tree_index(inputs, slice(1, None)))
    nothing = jnp.zeros_like(covariances[0])
    return ForwardPass(filtered, prepend(means[0], predicted.mean), prepend(nothing, gains), prepend(nothing, left))
