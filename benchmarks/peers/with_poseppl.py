"""The job in poseppl: bootstrap filter, backward simulation of as many trajectories as particles."""

import jax
import numpyro
import numpyro.distributions as dist
from job import DECAY, NOISE, NUM_PARTICLES, STEP

import poseppl

NAME, PACKAGE, METHOD = "poseppl", "poseppl", "bootstrap filter, backward simulation"


def initial(params, inputs):
    numpyro.sample("x", dist.Normal(0.0, 1.0))


def transition(params, state, inputs):
    numpyro.sample("x", dist.Normal(DECAY * state["x"], STEP))


def observation(params, state, inputs):
    numpyro.sample("z", dist.Normal(state["x"], NOISE))


def prepare(data):
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    filter = poseppl.particle_filter(model, NUM_PARTICLES)
    smoother = poseppl.backward_simulation_smoother(model)

    def run(seed):
        keys = jax.random.split(jax.random.key(seed))
        filtered = poseppl.run_filter(filter, keys[0], model.observe({"z": data}), collect=poseppl.collect_history)
        return poseppl.smooth(filtered.outputs, smoother, keys[1], data={"z": data})["summary/state_mean"].values[:, 0]

    return run
