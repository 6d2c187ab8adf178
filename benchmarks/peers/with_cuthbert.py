"""The job in cuthbert: bootstrap filter, exact backward simulation. Its time 0 has no data: x_0 is the first transition."""

import jax
import jax.numpy as jnp
from cuthbert import filter, smoother
from cuthbert.smc import backward_sampler, particle_filter
from cuthbertlib.resampling import systematic
from cuthbertlib.smc.smoothing import exact_sampling
from jax.scipy.stats import norm
from job import DECAY, NOISE, NUM_PARTICLES, STEP

NAME, PACKAGE, METHOD = "cuthbert", "cuthbert", "bootstrap filter, backward simulation"


def moments(x, first):
    return jnp.where(first, 0.0, DECAY * x), jnp.where(first, 1.0, STEP)


def propagate(key, x, inputs):
    mean, scale = moments(x, inputs[0])
    return mean + scale * jax.random.normal(key)


def prepare(data):
    inputs = jnp.arange(len(data)) == 0, jnp.asarray(data, jnp.float32)
    forward = particle_filter.build_filter(
        init_sample=jax.random.normal,
        propagate_sample=propagate,
        log_potential=lambda before, x, inputs: norm.logpdf(inputs[1], x, NOISE),
        n_filter_particles=NUM_PARTICLES,
        resampling_fn=systematic.resampling,
    )
    backward = backward_sampler.build_smoother(
        log_potential=lambda before, x, inputs: norm.logpdf(x, *moments(before, inputs[0])),
        backward_sampling_fn=exact_sampling.simulate,
        resampling_fn=systematic.resampling,
        n_smoother_particles=NUM_PARTICLES,
    )

    @jax.jit
    def smooth(key):
        keys = jax.random.split(key, 3)
        states = filter(forward, inputs, forward.init_prepare(key=keys[0]), key=keys[1])
        return smoother(backward, states, key=keys[2]).particles[1:].mean(1)

    return lambda seed: jax.block_until_ready(smooth(jax.random.key(seed)))
