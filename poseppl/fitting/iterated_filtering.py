r"""Iterated filtering (IF2): maximum likelihood of programs that can only be simulated.

Ionides, Nguyen, Atchade, Stoev and King 2015 (doi:10.1073/pnas.1410597112). Each of N particles has params of its own, which
are perturbed at every frame,

    u_t^i = u_(t-1)^i + \sigma_m e,    x_t^i ~ p(x_t | x_(t-1)^i, u_t^i),    w_t^i = p(z_t | x_t^i, u_t^i),

and resampled with the states. The swarm at the last frame starts the next pass, whose \sigma_m is smaller. Standard errors are
of a quadratic that is fitted to the filter's log-likelihoods around the estimate.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.checks import check_at_least, check_fraction
from poseppl.compilation import jit
from poseppl.diagnostics.verdicts.verdict import ERROR, INFO, WARNING, Findings, Remedy, Verdict
from poseppl.fitting.problem import Estimate, Problem, likelihood_error
from poseppl.particles.resampling import systematic
from poseppl.particles.weights import normalise
from poseppl.program.frame_inputs import split_inputs


def iterated_filtering_method(
    problem: Problem,
    rng_key: Array,
    start: Mapping[str, Any] | None,
    *,
    num_particles: int = 1000,
    num_passes: int = 50,
    num_starts: int = 4,
    perturbation: float = 0.05,
    cooling: float = 0.05,
) -> Estimate:
    """Iterated filtering: maximum likelihood of programs that can be simulated.

    Args:
        problem: The problem, whose filter estimates the likelihood at the estimate.
        rng_key: PRNG key.
        start: Params by name to start from; draws from the prior if None.
        num_particles: N of a swarm.
        num_passes: Passes through the data.
        num_starts: Swarms.
        perturbation: Standard deviation of a frame's perturbation at first, in unconstrained coordinates, in units of the
            prior's standard deviation there.
        cooling: Share of it that is left at the last pass.
    """
    check_at_least(1, num_passes=num_passes, num_starts=num_starts)
    check_at_least(2, num_particles=num_particles)
    check_fraction("(0, 1]", cooling=cooling)
    key_start, key_scale, key_passes, key_error, key_shape = jax.random.split(rng_key, 5)
    scales = jnp.std(problem.prior_draws(key_scale, 64), 0)
    density = problem.compiled("value", "log_likelihood")
    starts = problem.starts(key_start, num_starts, start, lambda u: float(density(u)))
    centres = jnp.asarray(starts, jnp.result_type(float))
    swarms = jnp.broadcast_to(centres[:, None], (num_starts, num_particles, centres.shape[1]))
    through = jit(jax.vmap(lambda key, swarm, sd: _pass(problem, key, swarm, sd), (0, 0, None)))
    trace = []
    for number in range(num_passes):
        sd = scales * perturbation * cooling ** (number / max(num_passes - 1, 1))
        swarms, evidence = through(jax.random.split(jax.random.fold_in(key_passes, number), num_starts), swarms, sd)
        trace.append(np.asarray(evidence, np.float64))
        problem.advance(1)
    ends = np.asarray(swarms, np.float64).mean(1)
    likelihoods = [likelihood_error(problem, key_error, end) for end in ends]
    best = int(np.argmax([each["log_likelihood"] for each in likelihoods]))
    shape = _local_quadratic(problem, key_shape, ends[best], np.asarray(scales, np.float64))
    findings = (*_of_swarms(np.array(trace), likelihoods, best), *_of_shape(shape))
    attrs = {**likelihoods[best], "optima": [each["log_likelihood"] for each in likelihoods]}
    attrs["converged"] = not any(each.severity == ERROR for each in findings)
    draws = np.full((1, 1000, len(scales)), np.nan)
    if np.isfinite(shape.covariance).all():
        draws[0] = np.random.default_rng(0).multivariate_normal(ends[best], shape.covariance, 1000)
    return Estimate(ends[best], shape.covariance, draws, {}, np.array(trace)[:, best], attrs, findings)


def _pass(problem: Problem, rng_key: Array, swarm: Array, sd: Array) -> tuple[Array, Array]:
    """One pass of a swarm (N, p) through the data: the swarm after it, and the perturbed model's log-evidence."""
    layout, varying, constant = split_inputs(problem.inputs)
    number = swarm.shape[0]

    def advance(carry: tuple[Array, Array, Array], row: Any) -> Any:
        us, xs, total = carry
        t, observation, varying = row
        inputs = layout.join(varying, constant)
        key_move, key_params, key_resample = jax.random.split(jax.random.fold_in(rng_key, t), 3)
        us = us + sd * jax.random.normal(key_params, us.shape, us.dtype)

        def follow(key: Array, u: Array, x: Array) -> tuple[Array, Array]:
            model = problem.bound(u)
            moved = jnp.where(t == 0, model.sample_initial(key, inputs), model.sample_transition(key, x, inputs))
            return moved, model.log_observation(moved, observation, inputs)

        xs, log_weights = jax.vmap(follow)(jax.random.split(key_move, number), us, xs)
        weighed = normalise(log_weights)
        ancestors = systematic(key_resample, weighed.log_weights, number)
        return (us[ancestors], xs[ancestors], total + weighed.log_mean), None

    states = jnp.zeros((number, problem.model.dimension), swarm.dtype)
    rows = jnp.arange(problem.num_frames), problem.observations, varying
    (swarm, _, total), _ = jax.lax.scan(advance, (swarm, states, jnp.zeros((), swarm.dtype)), rows)
    return swarm, total


class _Shape(NamedTuple):
    """The quadratic around an estimate: covariance of u (p, p), and how many errors its least curvature is above 0."""

    covariance: Floats
    certainty: float


def _local_quadratic(problem: Problem, rng_key: Array, centre: Floats, scales: Floats) -> _Shape:
    """Fit a quadratic to the filter's log-likelihoods at points around an estimate (p,), over about one standard error."""
    size = len(centre)
    upper = np.triu_indices(size)
    number = 8 * (1 + size + len(upper[0]))
    evaluate = jit(lambda us, keys: jax.vmap(problem.log_likelihood)(us, keys))
    radius, nothing = 0.1 * scales, np.full((size, size), np.nan)
    shape = _Shape(nothing, 0.0)
    for turn in range(3):
        key_points, key_runs = jax.random.split(jax.random.fold_in(rng_key, turn))
        white = np.asarray(jax.random.normal(key_points, (number, size)), np.float64)
        points = jnp.asarray(centre + white * radius, jnp.result_type(float))
        values = np.asarray(evaluate(points, jax.random.split(key_runs, number)), np.float64)
        usable = np.isfinite(values)
        products = white[:, upper[0]] * white[:, upper[1]]
        design = np.column_stack([np.ones(number), white, products])[usable]
        if len(design) < 2 * design.shape[1]:
            return _Shape(nothing, 0.0)
        inverse = np.linalg.pinv(design.T @ design)
        found = inverse @ design.T @ values[usable]
        spread = np.var(values[usable] - design @ found) * len(design) / (len(design) - design.shape[1])
        curvature = np.zeros((size, size))
        curvature[upper] = -found[1 + size :]
        curvature += curvature.T
        errors = np.sqrt(np.diagonal(inverse)[1 + size :] * spread)[upper[0] == upper[1]] * 2
        eigenvalues = np.linalg.eigvalsh(curvature)
        sound = eigenvalues[0] > 0
        shape = _Shape(np.linalg.inv(curvature) * np.outer(radius, radius) if sound else nothing, eigenvalues[0] / errors.max())
        # for the next turn, points over about one and a half standard errors
        diagonal = np.diagonal(curvature)
        radius = radius * np.clip(1.5 / np.sqrt(np.where(diagonal > 0, diagonal, 0.1)), 0.1, 5.0)
    return shape


def _of_swarms(trace: Floats, likelihoods: list[dict[str, float]], best: int) -> Findings:
    """Whether the passes still rise, and whether swarms agree."""
    if not np.isfinite(likelihoods[best]["log_likelihood"]):
        yield Verdict(ERROR, "The data are impossible under every estimate;", (Remedy("give another {}", "start"),))
        return
    of_best = trace[:, best]
    quarter = max(len(of_best) // 4, 1)
    last, before = of_best[-quarter:], of_best[-2 * quarter : -quarter]
    rise = last.mean() - before.mean() if len(before) else 0.0
    error = np.sqrt((last.var() + before.var()) / quarter) if len(before) else 0.0
    if not rise <= max(4 * error, 1.0):
        finding = f"The likelihood still rises, by {rise:.2g} over the last quarter of the passes: the search did not converge;"
        yield Verdict(ERROR, finding, (Remedy("raise {}", "num_passes"), Remedy("raise {}", "cooling")))
    most = likelihoods[best]
    apart = [
        each["log_likelihood"]
        < most["log_likelihood"] - 1.0 - 4 * np.hypot(each["log_likelihood_error"], most["log_likelihood_error"])
        for each in likelihoods
    ]
    if sum(apart):
        severity = WARNING if 2 * sum(apart) > len(apart) else INFO
        finding = f"{sum(apart)} of {len(apart)} swarms ended at a lower likelihood;"
        yield Verdict(severity, finding, (Remedy("raise {}", "num_passes"), Remedy("raise {}", "num_starts")))


def _of_shape(shape: _Shape) -> Findings:
    if not np.isfinite(shape.covariance).all():
        finding = "The log-likelihoods around the estimate have no maximum there: there are no standard errors;"
    elif shape.certainty < 3.0:
        finding = f"Standard errors are rough: the curvature is {shape.certainty:.1f} times its own error;"
    else:
        return
    yield Verdict(WARNING, finding, (Remedy("raise {}", "num_particles"), Remedy("raise {}", "num_passes")))
