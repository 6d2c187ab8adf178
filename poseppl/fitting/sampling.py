"""Posterior draws of the params: variational inference by NumPyro, NUTS by BlackJAX, PMMH and particle Gibbs."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Literal

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax import Array
from numpyro.infer import SVI, Trace_ELBO
from numpyro.infer.autoguide import AutoDiagonalNormal, AutoMultivariateNormal
from numpyro.infer.initialization import init_to_value

from poseppl.arrays import Floats
from poseppl.checks import check_at_least, check_choice
from poseppl.compilation import jit
from poseppl.diagnostics.inefficiency import array_stats
from poseppl.diagnostics.verdicts.verdict import ERROR, WARNING, Findings, Remedy, Verdict
from poseppl.errors import Argument, InputError
from poseppl.fitting.problem import Estimate, Problem, likelihood_error
from poseppl.kernels.adapted_chain import unchecked
from poseppl.smoothers.conditional_smc import Method as TrajectoryMethod
from poseppl.smoothers.particle_marginal import pmmh
from poseppl.smoothers.static_parameters import particle_gibbs

Guide = Literal["full-rank", "mean-field"]
_PARTS = 10
"""Reports of progress of a fit."""
_KHAT_BAD = 0.7
_DIVERGENT, _DIVERGENT_ERROR = 0.01, 0.05
_NOISY = 2.0
"""SD of the log-likelihood's estimate above which chains of PMMH stick."""


def svi_method(
    problem: Problem,
    rng_key: Array,
    start: Mapping[str, Any] | None,
    *,
    guide: Guide = "full-rank",
    num_steps: int = 1000,
    num_particles: int = 2,
    num_draws: int = 1000,
    step_size: float = 0.05,
) -> Estimate:
    """Variational inference: a Gaussian in unconstrained coordinates that maximises the evidence lower bound (ELBO).

    Args:
        problem: The problem.
        rng_key: PRNG key; the filter has another key at each step.
        start: Params by name to start from; the best of a few draws of the prior if None.
        guide: "full-rank" or "mean-field".
        num_steps: Steps of Adam.
        num_particles: Draws of the guide a step.
        num_draws: Draws of the fitted guide.
        step_size: Initial step size of Adam; it decays to a hundredth.
    """
    check_at_least(1, num_steps=num_steps, num_particles=num_particles, num_draws=num_draws)
    check_choice(Guide, guide=guide)
    check_gradient(problem)
    key_start, key_run, key_draws, key_fresh = jax.random.split(rng_key, 4)
    density = problem.compiled("value", "log_posterior")
    first = problem.starts(key_start, 1, start, lambda u: float(density(u)))[0]

    def program() -> None:
        space = dist.ImproperUniform(dist.constraints.real_vector, (), (problem.bijector.dimension,))
        u = numpyro.sample("u", space)
        numpyro.factor("posterior", problem.log_posterior(u, numpyro.prng_key()))

    family = AutoMultivariateNormal if guide == "full-rank" else AutoDiagonalNormal
    of_guide = family(program, init_loc_fn=init_to_value(values={"u": jnp.asarray(first, jnp.result_type(float))}))
    schedule = lambda step: step_size * 0.01 ** jnp.minimum(step / num_steps, 1.0)  # noqa: E731
    svi = SVI(program, of_guide, numpyro.optim.Adam(schedule), Trace_ELBO(num_particles))
    state, trace = jit(svi.init)(key_run), []
    length = -(-num_steps // _PARTS)
    steps = jit(lambda state: jax.lax.scan(lambda state, _: svi.update(state), state, None, length))
    for _ in range(_PARTS):
        state, losses = steps(state)
        trace += (-np.asarray(losses, np.float64)).tolist()
        problem.advance(length)
    fitted = of_guide.get_posterior(svi.get_params(state))
    draws = fitted.sample(key_draws, (num_draws,))
    keys = jax.random.split(key_fresh, num_draws)
    targets = jit(lambda: jax.lax.map(lambda row: problem.log_posterior(*row), (draws, keys), batch_size=16))()
    log_guide = jnp.sum(jnp.reshape(fitted.log_prob(draws), (num_draws, -1)), 1)  # mean-field: of each coordinate
    ratios = np.asarray(targets - log_guide, np.float64)
    khat = float(array_stats().psislw(np.where(np.isfinite(ratios), ratios, -1e30))[1])
    findings = tuple(_of_guide(np.array(trace), khat, guide))
    attrs = {"converged": not any(each.severity == ERROR for each in findings), "pareto_k": khat, "guide": guide}
    return Estimate(None, None, np.asarray(draws, np.float64)[None], {}, trace, attrs, findings)


def _of_guide(trace: Floats, khat: float, guide: Guide) -> Findings:
    """Whether the ELBO has stopped to rise, and whether the guide covers the posterior."""
    if not np.isfinite(trace).all():
        finding = f"The ELBO was not finite at {np.mean(~np.isfinite(trace)):.0%} of the steps;"
        yield Verdict(ERROR, finding, (Remedy("lower {}", "step_size"), Remedy("give another {}", "start")))
        return
    last, before = trace[-len(trace) // 10 :], trace[-len(trace) // 5 : -len(trace) // 10]
    rise = last.mean() - before.mean()
    error = np.sqrt((last.var(ddof=1) + before.var(ddof=1)) / len(last))
    if rise > max(4 * error, 0.1):
        finding = f"The ELBO still rises, by {rise:.2g} over the last tenth of the steps: the fit did not converge;"
        yield Verdict(ERROR, finding, (Remedy("raise {}", "num_steps"),))
    if not khat < _KHAT_BAD:
        finding = f"The guide does not cover the posterior (Pareto k {khat:.2f}, above {_KHAT_BAD}): standard errors are wrong;"
        wider = (Remedy("use {}", "guide", "full-rank"),) if guide == "mean-field" else ()
        yield Verdict(WARNING, finding, (*wider, Remedy("use {}", "method", "nuts")))


def check_gradient(problem: Problem) -> None:
    """Refuse a filter whose likelihood has no gradient."""
    if not problem.filter.differentiable:
        raise InputError(
            "its likelihood has no gradient", field=Argument("filter"), expected="another filter, or method 'pmmh'"
        )


def nuts_method(
    problem: Problem,
    rng_key: Array,
    start: Mapping[str, Any] | None,
    *,
    num_chains: int = 4,
    num_draws: int = 500,
    num_warmup: int = 500,
    target_acceptance: float = 0.8,
    max_doublings: int = 8,
) -> Estimate:
    """NUTS with window adaptation (BlackJAX), chains side by side.

    Args:
        problem: The problem; its likelihood has one key throughout.
        rng_key: PRNG key.
        start: Params by name that all chains start from; the best of a few draws of the prior if None.
        num_chains: M.
        num_draws: R, draws of each chain that count.
        num_warmup: Updates before them, in which step size and mass matrix are adapted.
        target_acceptance: Acceptance rate that the step size is adapted to.
        max_doublings: Less than 2 to this power leapfrog steps an update.
    """
    check_at_least(1, num_chains=num_chains, num_draws=num_draws, num_warmup=num_warmup)
    check_gradient(problem)
    key_start, key_warmup, key_draws = jax.random.split(rng_key, 3)
    density = problem.compiled("value", "log_posterior")
    starts = problem.starts(key_start, num_chains, start, lambda u: float(density(u)))
    warmup: Any = blackjax.window_adaptation(
        blackjax.nuts,
        problem.log_posterior,
        is_mass_matrix_diagonal=False,
        target_acceptance_rate=target_acceptance,
        max_num_doublings=max_doublings,
        adaptation_info_fn=lambda *_: None,
    )
    kernel: Any = blackjax.nuts.build_kernel()

    def warm(key: Array, position: Array) -> Any:
        found, _ = warmup.run(unchecked(key), position, num_warmup)
        return found.state, found.parameters["step_size"], found.parameters["inverse_mass_matrix"]

    def move(key: Array, state: Any, step_size: Array, mass: Array) -> Any:
        return kernel(unchecked(key), state, problem.log_posterior, step_size, mass, max_doublings)

    positions = jnp.asarray(starts, jnp.result_type(float))
    state, *adapted = jit(jax.vmap(warm))(jax.random.split(key_warmup, num_chains), positions)
    problem.advance(num_warmup)

    def part(state: Any, keys: Array) -> Any:
        def update(state: Any, key: Array) -> Any:
            state, info = jax.vmap(move)(jax.random.split(key, num_chains), state, *adapted)
            return state, (state.position, _statistics(state, info))

        return jax.lax.scan(update, state, keys)

    run, kept = jit(part), []
    for keys in np.array_split(np.arange(num_draws), min(_PARTS, num_draws)):
        state, found = run(state, jax.random.split(jax.random.fold_in(key_draws, keys[0]), len(keys)))
        kept.append(jax.tree.map(lambda leaf: np.swapaxes(np.asarray(leaf), 0, 1), found))
        problem.advance(len(keys))
    draws, statistics = jax.tree.map(lambda *leaves: np.concatenate(leaves, 1), *kept)
    findings = tuple(_divergences(statistics["diverging"]))
    return Estimate(None, None, draws.astype(np.float64), statistics, (), {}, findings)


def _statistics(state: Any, info: Any) -> dict[str, Array]:
    """Statistics of an update by the names that ArviZ has for them."""
    return {
        "lp": state.logdensity,
        "acceptance_rate": info.acceptance_rate,
        "diverging": info.is_divergent,
        "energy": info.energy,
        "n_steps": info.num_integration_steps,
    }


def _divergences(diverging: Any) -> Findings:
    share = float(np.mean(diverging))
    if share > _DIVERGENT:
        severity = ERROR if share > _DIVERGENT_ERROR else WARNING
        yield Verdict(severity, f"{share:.1%} of trajectories diverge;", (Remedy("raise {}", "target_acceptance"),))


def pmmh_method(
    problem: Problem,
    rng_key: Array,
    start: Mapping[str, Any] | None,
    *,
    num_chains: int = 4,
    num_draws: int = 1000,
    num_warmup: int = 500,
) -> Estimate:
    """Particle marginal Metropolis-Hastings: chains that accept by a filter's estimate of the likelihood.

    See :func:`~poseppl.smoothers.particle_marginal.pmmh`.

    Args:
        problem: The problem; its filter's evidence should be unbiased.
        rng_key: PRNG key.
        start: Params by name to start from; draws from the prior if None.
        num_chains: M.
        num_draws: R, draws of each chain that count.
        num_warmup: Updates before them, in which proposals are adapted.
    """
    key_run, key_error = jax.random.split(rng_key)
    settings: dict[str, Any] = {"num_chains": num_chains, "num_draws": num_draws, "num_warmup": num_warmup, "start": start}
    run = jit(
        partial(
            pmmh,
            problem.model,
            observations=problem.observations,
            inputs=problem.inputs,
            build_filter=problem.build_filter,
            **settings,
        )
    )
    found = run(key_run)
    problem.advance(num_warmup + num_draws)
    draws = np.asarray(found.unconstrained, np.float64)
    attrs = {"acceptance": float(found.acceptance), **likelihood_error(problem, key_error, draws.mean((0, 1)))}
    statistics = {"log_likelihood": np.asarray(found.log_evidence)}
    return Estimate(None, None, draws, statistics, (), attrs, tuple(noisy_likelihood(attrs["log_likelihood_sd"])))


def noisy_likelihood(spread: float) -> Findings:
    """Whether the filter's estimate of the log-likelihood is too noisy for chains that accept by it."""
    if not spread < _NOISY:
        finding = f"The filter's log-likelihood has a standard deviation of {spread:.1f} at the estimate: chains stick there;"
        yield Verdict(WARNING, finding, (Remedy("give the filter more particles (it should be about 1)"),))


def particle_gibbs_method(
    problem: Problem,
    rng_key: Array,
    start: Mapping[str, Any] | None,
    *,
    num_particles: int = 100,
    num_chains: int = 4,
    num_draws: int = 500,
    num_warmup: int = 250,
    trajectories: TrajectoryMethod = "ancestor",
) -> Estimate:
    """Particle Gibbs: trajectories given params, and params given trajectories, in turn.

    See :func:`~poseppl.smoothers.static_parameters.particle_gibbs`.

    Args:
        problem: The problem.
        rng_key: PRNG key.
        start: Params by name to start from; draws from the prior if None.
        num_particles: N of the conditional particle filter.
        num_chains: M.
        num_draws: R, draws of each chain that count.
        num_warmup: Updates before them, in which the step size is adapted.
        trajectories: How a trajectory is chosen: by ancestor sampling, or by backward simulation.
    """
    settings: dict[str, Any] = {"num_particles": num_particles, "num_chains": num_chains, "num_draws": num_draws}
    settings |= {"num_warmup": num_warmup, "method": trajectories, "start": start}
    model, data = problem.model, problem.observations

    def run(key: Array) -> tuple[Array, Array, Array]:
        found = particle_gibbs(model, key, data, problem.inputs, **settings)
        return found.unconstrained, found.acceptance, found.step_size  # trajectories would take much room

    draws, acceptance, step_size = jit(run)(rng_key)
    problem.advance(num_warmup + num_draws)
    attrs = {"acceptance": float(acceptance), "step_size": float(step_size)}
    return Estimate(None, None, np.asarray(draws, np.float64), {}, (), attrs)
