r"""The log-likelihood of static parameters, log p(z_1..T | params), as a pure function that can be differentiated.

    log_likelihood(model, params, data, filter)    =    sum over t of log p(z_t | z_(<t), params)

as a filter finds it. It may be called inside `jax.jit`, `jax.vmap` and `jax.grad`, and as a factor of a NumPyro program, whose
NUTS and SVI then infer parameters with the states integrated out. Frames and entries that are masked add 0 to value and
gradient. With which filter depends on what its gradient is:

* Kalman filters: value and gradient exact where the programs are linear and Gaussian, else those of the approximation;
* ensemble Kalman: those of the members' Gaussian, for the members that the key draws; both are biased by O(1 / N);
* particle, guided and Rao-Blackwellised filters: exp of the value is unbiased. The gradient is that of Scibior and Wood 2021
  (:mod:`poseppl.filters.adaptive_resampling`), with the score of states whose draws have no derivative, such as integers
  (:meth:`~poseppl.program.CompiledModel.differentiable_draw`): unbiased for the likelihood, biased by O(1 / N) for its
  logarithm. Its variance grows with T. With one key value and gradient are deterministic, but where ancestors change the value
  jumps, which the gradient does not see: NUTS then has divergences, and SVI or gradient ascent with another key at each step
  suit it better, or :func:`poseppl.smoothers.pmmh`, which needs no gradient and is exact;
* others (tempered, HMC): the value alone, and a gradient is refused; their moves accept or refuse, and none knows it.

>>> import numpyro, numpyro.distributions as dist
>>> from numpyro.infer import MCMC, NUTS
>>> from poseppl import StateSpaceModel, kalman_filter
>>> def parameters():
...     numpyro.sample("step", dist.HalfNormal(1.0))
>>> def initial(params, inputs):
...     numpyro.sample("level", dist.Normal(0.0, 1.0))
>>> def transition(params, state, inputs):
...     numpyro.sample("level", dist.Normal(state["level"], params["step"]))
>>> def observation(params, state, inputs):
...     numpyro.sample("height", dist.Normal(state["level"], 0.5))
>>> model = StateSpaceModel(initial, transition, observation, parameters).compile()
>>> data = model.observe({"height": [0.3, 0.5, float("nan"), 1.1, 0.9, 1.4]})

Five lines infer the parameter:

>>> def program():
...     step = numpyro.sample("step", dist.HalfNormal(1.0))
...     numpyro.factor("data", log_likelihood(model, {"step": step}, data, kalman_filter))
>>> mcmc = MCMC(NUTS(program), num_warmup=100, num_samples=100, progress_bar=False)
>>> mcmc.run(jax.random.key(0))

and so does SVI, with a guide in place of the sampler:

>>> from numpyro.infer import SVI, Trace_ELBO, autoguide
>>> svi = SVI(program, autoguide.AutoNormal(program), numpyro.optim.Adam(0.05), Trace_ELBO())
>>> fitted = svi.run(jax.random.key(1), 300, progress_bar=False)
>>> median = svi.guide.median(fitted.params)["step"]
>>> 0.2 < median < 0.8 and 0.2 < mcmc.get_samples()["step"].mean() < 0.8
Array(True, dtype=bool)

`arviz.from_numpyro(mcmc)` makes a result of it that ArviZ's functions take.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import jax
from jax import Array

from poseppl.checks import check_key
from poseppl.errors import InputError
from poseppl.filters.base import Filter
from poseppl.program import CompiledModel, Observation
from poseppl.runs.fitted_params import with_checked_params
from poseppl.smoothers.inner_filter import filter_evidence, filter_for


def log_likelihood(
    model: CompiledModel,
    params: Mapping[str, Any] | None,
    data: Observation | Mapping[str, Any],
    filter: Callable[[CompiledModel], Filter],
    rng_key: Array | None = None,
    inputs: Any = None,
) -> Array:
    """The log-likelihood of params, with the states integrated out; see the module for its gradient.

    Args:
        model: The compiled model.
        params: Constrained values by name, as the programs take them; None for a model that has its params, or none.
        data: An Observation with a leading T, or arrays by site, NaN where nothing was seen.
        filter: `model -> filter`: a builder such as `poseppl.kalman_filter`, or
            `lambda model: poseppl.particle_filter(model, 500)`.
        rng_key: PRNG key of the filter; always the same one if None, so that the value is a function of params.
        inputs: Inputs with a leading T, constant parts wrapped in :class:`~poseppl.runs.frame_sequence.Constant`; None where
            the model takes none.

    Returns:
        A scalar; -inf where the data are impossible.

    Raises:
        InputError: Params with other names than the parameters program, or the model's own; when differentiated, a filter that
            has no gradient.
        ValueError: Data or inputs that do not fit the model, a filter that is no function of the model, or one that has no
            evidence.
    """
    observations = model.observe(data)
    bound = model if params is None else with_checked_params(model, params)
    key = jax.random.key(0) if rng_key is None else rng_key
    check_key(key)
    built = filter_for(bound, filter)
    value = filter_evidence(built, key, observations, inputs)
    return value if built.differentiable else _without_gradient(value)


@jax.custom_jvp
def _without_gradient(value: Array) -> Array:
    return value


@_without_gradient.defjvp
def _no_gradient(primals: Any, tangents: Any) -> Any:
    raise InputError(
        "its moves are accepted or refused, and no gradient of the evidence knows it",
        field="filter",
        expected="a Kalman, particle, guided or Rao-Blackwellised filter for gradients, or pmmh, which needs none",
    )
