r"""Variational smoothing: the Gaussian of a whole trajectory that is nearest to the posterior, found by NumPyro's SVI.

The bound of the log-evidence

    ELBO(q) = E_q[log p(x, z) - log q(x)] = log p(z) - KL(q(x) || p(x | z))

is raised by Adam (optax) over Gaussians q(x) of the flat, unconstrained states x = (x_0, ..., x_(T-1)). Two families:

* "markov": any mean, and any precision P = L L^T whose blocks lie on the diagonal and beside it, as the posterior's do where
  the model is linear and Gaussian (:mod:`poseppl.gaussians.block_tridiagonal`): x = m + L^(-T) e, O(T d^2) a draw;
* "mean-field": independent coordinates. Its means are right for a Gaussian posterior, its variances 1 / P_ii are those of a
  coordinate given all others, and too small.

The search starts at Laplace's approximation (:mod:`poseppl.smoothers.laplace`), or at BlackJAX's Pathfinder (Zhang, Carpenter,
Gelman and Vehtari 2022, https://jmlr.org/papers/v23/21-0889.html), which needs no mode. It goes on in coordinates in which that
start is a standard normal, so that one step size serves all units. The gradient leaves the score of q out (sticking the
landing: Roeder, Wu and Duvenaud 2017, arXiv:1703.09194), so that it has no variance where q is the posterior.

The bound does not show the remaining KL divergence, but the draws' ratios p(x, z) / q(x) do. The result contains these ratios,
and the verdicts judge the tail of their distribution: Pareto's k by smoothed importance sampling (Yao et al. 2018,
arXiv:1802.02538) by ArviZ.

Sites must be continuous. q has one mode and symmetric tails.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import blackjax
import jax
import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
import optax
from jax import Array
from numpyro.infer import SVI, Trace_ELBO

from poseppl.checks import RangeError, check_at_least, check_choice
from poseppl.gaussians.block_tridiagonal import BlockCholesky, marginal_covariances, solve_upper
from poseppl.gaussians.gaussian import diagonal, lower_inverse
from poseppl.gaussians.marginals import gaussian_marginals
from poseppl.gaussians.trajectory_distribution import TrajectoryNormal
from poseppl.particles.weights import nan_to_neg_inf
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.smoothers.base import Approximation, History, Smoothed, Smoother, check_continuous, smoothed_draws
from poseppl.smoothers.curvature import safe_cholesky, trajectory_precisions
from poseppl.smoothers.laplace import TrajectoryGaussian, laplace_approximation, mean_trajectory

Family = Literal["markov", "mean-field"]
Start = Literal["laplace", "pathfinder"]
Params = dict[str, Array]

_TOGETHER = 50
"""Trajectories that are drawn side by side."""
_PATHFINDER_DRAWS = 20
"""Draws that estimate the bound at each point of Pathfinder's path."""


class SVISettings(NamedTuple):
    """Settings of the search.

    Attributes:
        num_steps: Steps of Adam.
        num_samples: Trajectories that a step's gradient is averaged over.
        learning_rate: Learning rate of the first step; it falls to 0 by a cosine.
    """

    num_steps: int
    num_samples: int
    learning_rate: float


@memoized_builder
def variational_smoother(
    model: CompiledModel,
    *,
    family: Family = "markov",
    start: Start = "laplace",
    num_steps: int = 300,
    num_samples: int = 10,
    learning_rate: float = 0.02,
    num_draws: int = 500,
    num_mode_steps: int = 100,
) -> Smoother:
    """The Gaussian of the whole trajectory that is nearest to the posterior, with the bound of the evidence.

    Args:
        model: The compiled model; all its sites are continuous.
        family: "markov", a block-tridiagonal precision, or "mean-field", independent coordinates with too small variances.
        start: "laplace", or "pathfinder", which needs no search of a mode.
        num_steps: Steps of the search.
        num_samples: Trajectories that a step's gradient is averaged over.
        learning_rate: Learning rate of the first step, in standard deviations of the start.
        num_draws: N, independent trajectories that are drawn.
        num_mode_steps: Steps of the search of the mode at most, as in the Laplace smoother.

    Returns:
        The smoother; its particles are (T, N, d), and those of one index are a whole trajectory if the family is "markov".
        Moments are those of the Gaussian. ``Smoothed.approximation`` has the bound and the draws' ratios.

    Raises:
        ValueError: A number out of range, an unknown family or start, or a model with discrete sites.
    """
    check_at_least(1, num_samples=num_samples, num_draws=num_draws, num_mode_steps=num_mode_steps)
    check_at_least(0, num_steps=num_steps)
    check_choice(Family, family=family)
    check_choice(Start, start=start)
    if not learning_rate > 0:
        raise RangeError("learning_rate", learning_rate, "a positive number")
    check_continuous(model)
    settings = SVISettings(num_steps, num_samples, learning_rate)

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        key_start, key_fit, key_draw = jax.random.split(rng_key, 3)

        def log_density(xs: Array) -> Array:
            return nan_to_neg_inf(model.log_joint(xs, observations, inputs))

        if start == "laplace":
            first = laplace_approximation(model, history, observations, inputs, num_mode_steps)
        else:
            first = pathfinder_approximation(key_start, model, history, observations, inputs)
        guide, params = (markov_guide if family == "markov" else mean_field_guide)(first)
        params, bound = fit_guide(key_fit, log_density, guide, params, settings)
        nearest = guide(params)
        draws, ratios = _draw(key_draw, log_density, nearest, num_draws)
        marginals = gaussian_marginals(nearest.loc, marginal_covariances(nearest.factor).own)
        count = len(nearest.loc) * (first.num_steps + num_steps * num_samples)
        smoothed = smoothed_draws(jnp.moveaxis(draws, 0, 1), marginals, num_gradient=count)
        return smoothed._replace(approximation=Approximation(bound, ratios))

    return Smoother(smooth, joint=family == "markov", closed_form=True)


Guide = Callable[[Params], TrajectoryNormal]


def markov_guide(first: TrajectoryGaussian) -> tuple[Guide, Params]:
    """Gaussians of any block-tridiagonal precision, in coordinates in which the first one is at 0 with unit scales.

    The guide's are V_t W_t, with V_t lower triangular, and K_t + A_(t+1)^T D_t W_t. Here W_t and K_t are those of the first
    one, and A_t is the inverse of a root of its covariance of frame t.
    """
    (num_frames, dimension), dtype = first.mean.shape, first.mean.dtype
    white = jax.vmap(lambda block: lower_inverse(jnp.linalg.cholesky(block)))(marginal_covariances(first.factor).own)

    def guide(params: Params) -> TrajectoryNormal:
        lower = jnp.tril(params["lower"], -1) + jax.vmap(jnp.diag)(jnp.exp(diagonal(params["lower"])))
        beside = jnp.einsum("tji,tjk,tkl->til", white[1:], params["beside"], first.factor.inverses[:-1])
        factor = BlockCholesky(lower @ first.factor.inverses, first.factor.gains + beside)
        return TrajectoryNormal(first.mean + solve_upper(first.factor, params["mean"]), factor)

    square = jnp.zeros((num_frames, dimension, dimension), dtype)
    return guide, {"mean": jnp.zeros_like(first.mean), "lower": square, "beside": square[1:]}


def mean_field_guide(first: TrajectoryGaussian) -> tuple[Guide, Params]:
    """Gaussians of independent coordinates, in the coordinates of :func:`markov_guide` for the mean."""
    # the precision's diagonal: rows of L^T, whose blocks are W_t^(-1) and K_t of the frame before
    roots = jax.vmap(lower_inverse)(first.factor.inverses)
    beside = jnp.einsum("tij,tjk->tik", first.factor.gains, roots[:-1])
    precision = jnp.sum(roots**2, -1).at[1:].add(jnp.sum(beside**2, -1))
    gains = jnp.zeros_like(first.factor.gains)

    def guide(params: Params) -> TrajectoryNormal:
        scale = jnp.exp(params["log_scale"]) / jnp.sqrt(precision)
        mean = first.mean + solve_upper(first.factor, params["mean"])
        return TrajectoryNormal(mean, BlockCholesky(jax.vmap(jnp.diag)(scale), gains))

    return guide, {"mean": jnp.zeros_like(first.mean), "log_scale": jnp.zeros_like(first.mean)}


def fit_guide(
    rng_key: Array, log_density: Callable[[Array], Array], guide: Guide, params: Params, settings: SVISettings
) -> tuple[Params, Array]:
    """Raise the bound by NumPyro's SVI; a step whose bound or gradient is not finite is left out.

    Args:
        rng_key: PRNG key.
        log_density: Log-density of a trajectory (T, d) with its data.
        guide: The Gaussian of params.
        params: Start.
        settings: Settings of the search.

    Returns:
        The params, and the bound's estimate before each step (num_steps,).
    """

    def target() -> None:
        xs = numpyro.sample("xs", dist.ImproperUniform(dist.constraints.real, (), params["mean"].shape))
        numpyro.factor("density", log_density(xs))

    def sampler() -> None:
        numpyro.sample("xs", guide({name: numpyro.param(name, value) for name, value in params.items()}))

    if settings.num_steps == 0:
        return params, jnp.zeros(0, params["mean"].dtype)
    rate = optax.cosine_decay_schedule(settings.learning_rate, settings.num_steps)
    svi = SVI(target, sampler, optax.adam(rate), Trace_ELBO(settings.num_samples))
    state, losses = jax.lax.scan(lambda state, _: svi.stable_update(state), svi.init(rng_key), length=settings.num_steps)
    found: Params = svi.get_params(state)
    return found, -losses


def pathfinder_approximation(
    rng_key: Array, model: CompiledModel, history: History, observations: Observation, inputs: Any
) -> TrajectoryGaussian:
    """The point of BlackJAX's Pathfinder from the filter's mean with the highest bound, with the curvature there."""
    precision = trajectory_precisions(model, observations, inputs)
    mean = mean_trajectory(history)
    factor = safe_cholesky(precision(mean, majorised=True))

    def log_density(white: Array) -> Array:
        return model.log_joint(mean + solve_upper(factor, white), observations, inputs)

    found, _ = blackjax.pathfinder.approximate(rng_key, log_density, jnp.zeros_like(mean), _PATHFINDER_DRAWS)
    moved = mean + solve_upper(factor, found.position)
    mean = jnp.where(jnp.all(jnp.isfinite(moved)), moved, mean)
    return TrajectoryGaussian(mean, safe_cholesky(precision(mean)), jnp.zeros((), int))


def _draw(
    rng_key: Array, log_density: Callable[[Array], Array], nearest: TrajectoryNormal, num_draws: int
) -> tuple[Array, Array]:
    """Trajectories (N, T, d), and log p(x, z) - log q(x) of each (N,)."""

    def draw(key: Array) -> tuple[Array, Array]:
        xs = nearest.sample(key)
        return xs, log_density(xs) - nearest.log_prob(xs)

    drawn: tuple[Array, Array] = jax.lax.map(draw, jax.random.split(rng_key, num_draws), batch_size=_TOGETHER)
    return drawn
