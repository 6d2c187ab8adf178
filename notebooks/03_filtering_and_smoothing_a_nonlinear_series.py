# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # Filtering and smoothing a nonlinear series
#
# A filter knows the past. A smoother knows the future too, and in a model where the present is ambiguous that may decide
# everything. Here is a series of one number that is as hard as one number can be, the growth model of the smoothing
# literature,
#
# $$x_t = \tfrac12 x_{t-1} + \frac{25\,x_{t-1}}{1 + x_{t-1}^2} + 8\cos(1.2\,t) + \mathcal N(0, 10), \qquad
#   y_t = \tfrac1{20} x_t^2 + \mathcal N(0, 1).$$
#
# The data see the square of the state: its size, not its sign. Only how the state moves tells the sign, and often only
# later. With one dimension, a grid gives the exact answer, so that everything below can be held against the truth.

# %%
import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.toys.growth import growth, growth_mean

import poseppl
from poseppl.filters import kalman_filter, particle_filter
from poseppl.particles.weights import weighted_mean
from poseppl.report import new_picture
from poseppl.runs.run import run_filter
from poseppl.smoothers import (
    backward_simulation_smoother,
    collect_history,
    forward_backward_smoother,
    genealogy_smoother,
    trajectory_smoother,
    viterbi_smoother,
)

NUM_FRAMES = 60
times = np.arange(1.0, NUM_FRAMES + 1, dtype=np.float32)
model = growth().compile(times[0])
truth, data = poseppl.simulate(model, jax.random.key(1), NUM_FRAMES, times)
observations = model.observe({"y": data["y"]})
truth = np.asarray(truth)[:, 0]

# %% [markdown]
# ## The exact answer
#
# On a grid the state is a hidden Markov model, and two sweeps give the exact filtering and smoothing distributions.

# %%
grid = np.linspace(-40, 40, 801)


def transition_matrix(time):
    """Probabilities of moving from each point (rows) to each other (columns)."""
    log_density = -0.5 * (grid[None] - np.asarray(growth_mean(grid, time))[:, None]) ** 2 / 10
    weights = np.exp(log_density)
    return weights / weights.sum(1, keepdims=True)


likelihood = np.exp(-0.5 * (np.asarray(data["y"])[:, None] - grid**2 / 20) ** 2)
first = np.exp(-0.5 * grid**2 / 10) * likelihood[0]
filtered = [first / first.sum()]
for t in range(1, NUM_FRAMES):
    joint = filtered[-1] @ transition_matrix(times[t]) * likelihood[t]
    filtered.append(joint / joint.sum())
backward, smoothed = np.ones(len(grid)), [filtered[-1]]
for t in range(NUM_FRAMES - 1, 0, -1):
    backward = transition_matrix(times[t]) @ (likelihood[t] * backward)
    backward /= backward.max()
    both = filtered[t - 1] * backward
    smoothed.append(both / both.sum())
filtered, smoothed = np.array(filtered), np.array(smoothed[::-1])
exact = {"filter": filtered @ grid, "smoother": smoothed @ grid}


def error(mean, of):
    """Root mean square distance from the exact mean."""
    return float(np.sqrt(np.mean((np.asarray(mean).ravel() - exact[of]) ** 2)))


# %% [markdown]
# ## Filtering
#
# Two filters: particles, which can be in two places at once, and an extended Kalman filter, which cannot. The collector
# `collect_history` keeps every particle with its weight and its ancestor: what a smoother needs.

# %%
NUM_PARTICLES = 1000
key = jax.random.key(0)
run = run_filter(particle_filter(model, NUM_PARTICLES), key, observations, times, collect=collect_history)
history = run.outputs
particle_means = jax.vmap(weighted_mean)(history.particles, history.log_weights)

kalman = run_filter(kalman_filter(model, 1000), key, observations, times, collect=collect_history)
kalman_means = kalman.outputs.particles.mean(1)
print(f"particle filter: {error(particle_means, 'filter'):.2f} from the exact filtered mean")
print(f"extended Kalman filter: {error(kalman_means, 'filter'):.2f}")

# %% [markdown]
# ## Smoothing
#
# A smoother is one function of the history. Five of them, from the cheapest to the strongest:
#
# * **genealogy**: the ancestors of the particles that made it to the end. It costs nothing, and a few dozen frames back
#   everyone has the same ancestor;
# * **forward-backward reweighting**: the particles stay where they are, and get new weights from what came after;
# * **backward simulation**: whole trajectories drawn backwards through the particles;
# * **Viterbi**: the one most probable path, an answer to another question;
# * **NUTS** on all frames at once, four chains. It climbs along one arrangement of signs: a strong sampler, and the wrong
#   one where the posterior falls into separate modes.

# %%
smoothers = {
    "genealogy": genealogy_smoother(model),
    "forward-backward": forward_backward_smoother(model),
    "backward simulation": backward_simulation_smoother(model, 300),
    "Viterbi": viterbi_smoother(model),
    "NUTS": trajectory_smoother(model, num_chains=4, num_draws=100, num_warmup=100),
}
means, spread = {}, {}
for name, smoother in smoothers.items():
    result = jax.jit(smoother.smooth)(jax.random.key(1), jax.tree.map(jnp.asarray, history), observations, times)
    particles = result.particles.reshape(NUM_FRAMES, -1)
    weights = jax.nn.softmax(result.log_weights.reshape(NUM_FRAMES, -1), axis=1)
    means[name] = np.sum(weights * particles, 1)
    spread[name] = len(np.unique(particles[0][np.asarray(weights[0]) > 0]))
    print(f"{name:>20}: {error(means[name], 'smoother'):.2f} from the exact mean; {spread[name]} states in the first frame")

# %% [markdown]
# The picture: the exact filtering and smoothing distributions as shades of grey, the truth in black. The smoother decides
# between two signs in frames where the filter cannot.

# %%
figure = new_picture(10, 6)
for axes, density, what in zip(figure.subplots(2, sharex=True), (filtered, smoothed), ("filter", "smoother"), strict=True):
    axes.pcolormesh(times, grid, np.sqrt(density.T), cmap="Greys")
    axes.plot(times, truth, "k.", markersize=4, label="truth")
    found = np.asarray(particle_means)[:, 0] if what == "filter" else means["forward-backward"]
    axes.plot(times, found, color="tab:blue", label="particle filter" if what == "filter" else "forward-backward")
    axes.set(ylabel="state", ylim=(-30, 30), title=what)
    axes.legend(loc="upper right")
figure.axes[-1].set_xlabel("time")
figure

# %% [markdown]
# ## What to take home
#
# Reweighting and backward simulation agree with the grid to within their Monte Carlo error; the genealogy has forgotten
# the beginning; a Gaussian filter is lost from the start. And smoothing pays: the exact smoothed mean is closer to the
# truth than the exact filtered one.

# %%
gain = {what: float(np.sqrt(np.mean((mean - truth) ** 2))) for what, mean in exact.items()}
print(gain)

# what N weighted draws of the exact distribution would miss, from its variance and the effective number of particles
variance = filtered @ grid**2 - exact["filter"] ** 2
expected = np.sqrt(np.mean(variance / run.info.ess))
assert error(particle_means, "filter") < 3 * expected
assert error(kalman_means, "filter") > 3 * error(particle_means, "filter")
variance = smoothed @ grid**2 - exact["smoother"] ** 2
assert error(means["backward simulation"], "smoother") < 3 * np.sqrt(variance.mean() / 300)
assert error(means["forward-backward"], "smoother") < 3 * np.sqrt(variance.mean() / 300)
for name in ("genealogy", "Viterbi", "NUTS"):
    assert error(means[name], "smoother") > 3 * error(means["forward-backward"], "smoother")
assert spread["genealogy"] < 20 < spread["backward simulation"]
assert gain["smoother"] < gain["filter"]
