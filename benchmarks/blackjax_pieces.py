"""Our pieces beside the ones of BlackJAX that they replace: resampling, and the step size of chains with a short warm-up.

    python -m benchmarks.blackjax_pieces [--quick] [--repeats 20]

Resampling: processor milliseconds of a call, ours and BlackJAX's. Step size: chains of HMC on a standard normal start with a
step size that is wrong by a factor. They adapt it in 6 updates, by the Robbins-Monro recursion of the HMC filters and by
BlackJAX's dual averaging. The output is the root mean square difference of the mean acceptance rate from its target after them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, get_args

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
from blackjax.adaptation.step_size import dual_averaging_adaptation
from blackjax.smc import resampling
from jax import Array

from benchmarks.timing import arguments, show
from poseppl.cli.console import start_jax
from poseppl.kernels.hmc import HMCSettings, adapted_step_size
from poseppl.particles.resampling import Scheme, resample

SIZES = (1_000, 10_000, 100_000)
FACTORS = (0.1, 0.3, 1.0, 3.0)
"""Multiples of a step size that is about right."""
CHAINS, DIMENSION, STEPS, LEAPFROG = 20, 10, 6, 10


def processor_seconds(call: Callable[[Array], Array], repeats: int) -> float:
    """Least processor seconds of a call with a key."""
    keys = jax.random.split(jax.random.key(0), repeats + 1)
    call(keys[0]).block_until_ready()
    seconds = []
    for key in keys[1:]:
        start = time.process_time()
        call(key).block_until_ready()
        seconds.append(time.process_time() - start)
    return min(seconds)


def _swapped(call: Any, weights: Array, size: int, key: Array) -> Any:
    return call(key, weights, size)


def resampling_rows(repeats: int) -> list[list[str]]:
    """Milliseconds of each scheme and size."""
    rows = []
    for name in get_args(Scheme):
        theirs: Any = jax.jit(getattr(resampling, name), static_argnums=2)
        ours: Any = jax.jit(partial(resample, scheme=name), static_argnums=2)
        for size in SIZES:
            log_weights = 0.5 * jax.random.normal(jax.random.key(1), (size,))
            calls = ((ours, log_weights), (theirs, jax.nn.softmax(log_weights)))
            seconds = [processor_seconds(partial(_swapped, call, weights, size), repeats) for call, weights in calls]
            rows.append([name, f"{size:,}", *(f"{1000 * each:.2f}" for each in seconds)])
    return rows


def acceptance_error(factor: float, robbins_monro: bool, repeats: int) -> float:
    """Root mean square distance of the acceptance rate from its target after the warm-up."""
    settings, kernel = HMCSettings(num_warmup=STEPS), blackjax.hmc.build_kernel()
    target = settings.target_acceptance or 0.0
    begin, improve, _ = dual_averaging_adaptation(target)

    def log_density(x: Array) -> Array:
        return -0.5 * x @ x

    def move(keys: Array, states: Any, step_size: Array) -> Any:
        ones = jnp.ones(DIMENSION)
        return jax.vmap(lambda key, state: kernel(key, state, log_density, step_size, ones, LEAPFROG))(keys, states)

    def once(key: Array) -> Array:
        key_start, key = jax.random.split(key)
        states = jax.vmap(lambda x: blackjax.hmc.init(x, log_density))(jax.random.normal(key_start, (CHAINS, DIMENSION)))
        log_step_size = jnp.log(0.4 * factor)
        averaging: Any = begin(jnp.exp(log_step_size))
        for number in range(STEPS):
            key, key_move = jax.random.split(key)
            states, info = move(jax.random.split(key_move, CHAINS), states, jnp.exp(log_step_size))
            rate = jnp.mean(info.acceptance_rate)
            if robbins_monro:
                log_step_size = adapted_step_size(log_step_size, rate, jnp.asarray(number), settings)
            else:
                averaging = improve(averaging, rate)
                log_step_size = averaging.log_step_size if number < STEPS - 1 else averaging.log_step_size_avg
        rates = move(jax.random.split(key, CHAINS), states, jnp.exp(log_step_size))[1].acceptance_rate
        return jnp.mean(rates)

    rates = jax.jit(jax.vmap(once))(jax.random.split(jax.random.key(0), repeats))
    return float(np.sqrt(np.mean((np.asarray(rates, float) - target) ** 2)))


def main() -> None:
    options = arguments(__doc__, repeats=20)
    start_jax()
    repeats = 2 if options.quick else options.repeats
    show("Resampling, ms", ["scheme", "N", "ours", "BlackJAX"], resampling_rows(repeats))
    errors = [
        [f"{factor:g}", *(f"{acceptance_error(factor, own, 10 * repeats):.3f}" for own in (True, False))] for factor in FACTORS
    ]
    show("Acceptance rate after 6 updates, error", ["step size wrong by", "Robbins-Monro", "dual averaging"], errors)


if __name__ == "__main__":
    main()
