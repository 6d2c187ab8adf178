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
# # A state-space model in ten lines
#
# Something hidden moves, and we see it dimly. A state-space model says how it moves, how it is seen, and where it may be at
# first; filtering turns that around and says, at each frame, what the data so far tell about the hidden state. Here we write
# such a model and filter a sequence with a gap. We keep the result in a form for ArviZ, and check every number against the
# exact answer.
#
# The model is chosen so that there is an exact answer. A weight bobs on a spring: position and velocity are the hidden
# state, and a noisy ruler reads the position. With Gaussian noise everywhere this is linear and Gaussian, so Kalman's
# recursion solves it. Nothing below knows that, except for the one cell that computes Kalman's answer to compare with.
#
# ## The model
#
# Three NumPyro programs, ten lines. The sites of the first two are the state; each sample site of the third is data.
# `inputs` is what is known at each frame (time step, camera, controls): nothing, here. `params` holds constants, and here
# there are none.

# %%
import arviz_stats
import jax
import numpy as np
import numpyro
import numpyro.distributions as dist

import poseppl
from poseppl.report import new_picture, plot_inefficiency, plot_state

STEP, STIFFNESS = 0.1, 4.0  # seconds, and the square of the angular frequency


def initial(params, inputs):
    numpyro.sample("position", dist.Normal(0.0, 1.0))
    numpyro.sample("velocity", dist.Normal(0.0, 2.0))


def transition(params, state, inputs):
    velocity = state["velocity"] - STEP * STIFFNESS * state["position"]
    numpyro.sample("position", dist.Normal(state["position"] + STEP * velocity, 0.02))
    numpyro.sample("velocity", dist.Normal(velocity, 0.15))


def observation(params, state, inputs):
    numpyro.sample("reading", dist.Normal(state["position"], 0.3))


model = poseppl.StateSpaceModel(initial, transition, observation).compile()
model.coordinate_names

# %% [markdown]
# Compiling runs the programs once and checks that they fit together: that `transition` samples the sites that `initial`
# does, in the same shapes, and so on. A misspelt site is refused with a message that names it, where NumPyro alone would
# have sampled a fresh variable in silence.


# %%
def misspelt(params, state, inputs):
    numpyro.sample("postion", dist.Normal(state["position"], 0.02))
    numpyro.sample("velocity", dist.Normal(state["velocity"], 0.15))


try:
    poseppl.StateSpaceModel(initial, misspelt, observation).compile()
except ValueError as error:
    refusal = str(error)
print(refusal)

# %% [markdown]
# ## Data, with a hole
#
# The programs also simulate. We draw eight seconds, and then the ruler is out of sight for twelve frames. Missing data
# are NaN; at the boundary they become a mask, and inside the library there is no NaN at all.

# %%
NUM_FRAMES = 80
truth, readings = poseppl.simulate(model, jax.random.key(3), NUM_FRAMES)
values = np.array(readings["reading"])
hidden = slice(40, 52)
values[hidden] = np.nan
data = {"reading": values}

# %% [markdown]
# ## Filtering
#
# A filter is a pair of pure functions, `init` for the first frame and `step` for each later one. The particle filter carries
# a swarm of weighted guesses: it moves each by `transition`, weighs it by the density of the reading, and resamples. `infer`
# runs the pair over the whole sequence in one compilation. For each frame it keeps two hundred draws, and the mean, standard
# deviation and quantiles over all particles.

# %%
particles = poseppl.particle_filter(model, num_particles=4000)
about = {"truth": truth, "rate": 1 / STEP, "attrs": {"model": "a weight on a spring"}}
result = poseppl.infer(model, data, particles, jax.random.key(0), **about)
result

# %% [markdown]
# The result is an xarray DataTree with named coordinates. `poseppl.save_result` writes it as NetCDF. Figures are one call
# each: the blue line is the mean, the band the central 90 % interval, black is the truth. In the hole the band widens,
# but the spring goes on swinging: a filter is a model that keeps running when the data stop.

# %%
plot_state(result)

# %% [markdown]
# ### Frame by frame
#
# The same filter can be fed as the readings come in. It is the same computation: the random key of a frame is derived
# from its number, so the online filter ends where the run over the whole sequence ended.

# %%
online = poseppl.Online(particles, jax.random.key(0))
live = []
for reading in values:
    state, info = online.update({"reading": reading})
    live.append(float(np.exp(state.log_weights) @ state.particles[:, 0]))
print(f"after {online.frame} frames the position is {live[-1]:.3f}, its truth {float(truth[-1, 0]):.3f}")

# %% [markdown]
# ## The exact answer
#
# Kalman's recursion, for the matrices that the ten lines above amount to. A missing reading is a step without an update.

# %%
A = np.array([[1 - STEP**2 * STIFFNESS, STEP], [-STEP * STIFFNESS, 1.0]])
Q = np.diag([0.02**2, 0.15**2])
H, R = np.array([[1.0, 0.0]]), 0.3**2


def kalman(readings):
    mean, covariance = np.zeros(2), np.diag([1.0, 4.0])
    means, deviations, log_evidence = [], [], []
    for t, reading in enumerate(readings):
        if t > 0:
            mean, covariance = A @ mean, A @ covariance @ A.T + Q
        increment = 0.0
        if np.isfinite(reading):
            variance = (H @ covariance @ H.T).item() + R
            surprise = reading - mean[0]
            gain = covariance @ H.T / variance
            mean, covariance = mean + gain[:, 0] * surprise, covariance - gain @ H @ covariance
            increment = -0.5 * (surprise**2 / variance + np.log(2 * np.pi * variance))
        means.append(mean)
        deviations.append(np.sqrt(np.diagonal(covariance)))
        log_evidence.append(increment)
    return np.array(means), np.array(deviations), np.array(log_evidence)


exact_mean, exact_sd, exact_evidence = kalman(values)

# %% [markdown]
# A particle filter is random, so "agrees" needs a yardstick: run it sixteen times with different keys (nothing is
# compiled anew), and the spread of the sixteen answers tells how far their average may stray from the truth. Within five
# standard errors is agreement.
#
# A check is worth as much as its power to fail. So we also ask it whether the filter agrees with a Kalman filter that was
# handed the classical mistake: zeros where the readings are missing.

# %%
NUM_RUNS = 16


def repeat(filter: poseppl.Filter):
    results = [poseppl.infer(model, data, filter, key) for key in jax.random.split(jax.random.key(9), NUM_RUNS)]
    return np.array([result["summary/state_mean"] for result in results])


def errors_apart(answers, expected):
    """How many standard errors the average of the answers (run, frame, coordinate) is from what is expected."""
    return (answers.mean(0) - expected) / (answers.std(0, ddof=1) / np.sqrt(NUM_RUNS))


answers = repeat(particles)
apart = errors_apart(answers, exact_mean)
mistaken = errors_apart(answers, kalman(np.nan_to_num(values))[0])
print(f"standard errors between particles and Kalman: {np.abs(apart).max():.1f} at most")
print(f"... and a Kalman filter that took the hole for zeros: {np.abs(mistaken).max():.0f}")

# %% [markdown]
# The filter also estimates how probable the data were, frame by frame: the evidence, by which models are compared.

# %%
evidence = result["sample_stats/log_evidence"].values
print(f"log-evidence: particles {evidence.sum():.2f}, exact {exact_evidence.sum():.2f}")

# %% [markdown]
# ## Another filter, the same model
#
# Particles are guesses; in many dimensions no swarm is large enough. Hamiltonian Monte Carlo walks instead, along the
# gradient of the posterior, which the programs give for free. `hmc_filter` is the filter of Choo and Fleet (2001), whose
# temporal prior is a mixture over the chains' last states. `assumed_density_filter` fits a Gaussian to all draws instead,
# and is what tracks bodies by default. For this model it is exact but for Monte Carlo error.
#
# The step size is in standard deviations of the posterior, and could adapt to an acceptance rate. For a round Gaussian in
# two dimensions that is a trap: hardly anything is ever rejected, the steps grow, and a trajectory comes round to where
# it began. Fixed at 0.3, three to six steps go about a quarter of the way round, which is the best there is.

# %%
settings = poseppl.HMCSettings(
    num_updates=110, num_warmup=10, num_leapfrog=6, step_size=0.3, target_acceptance=None, jitter=0.5
)
walkers = poseppl.assumed_density_filter(model, num_chains=16, settings=settings, num_starts=4)
chains = poseppl.infer(model, data, walkers, jax.random.key(1), **about)

# %% [markdown]
# Its draws are Markov chains, so ArviZ's diagnostics apply to the tree.

# %%
arviz_stats.summary(chains.isel(frame=[0, 45, 79]), var_names=["position", "velocity"])

# %%
flat = "unconstrained_posterior"
rhat, effective = (figure(chains, group=flat)["state"] for figure in (arviz_stats.rhat, arviz_stats.ess))
print(f"R-hat at most {float(rhat.max()):.3f}; 1600 draws are worth {float(effective.min()):.0f} or more independent ones")

# %%
plot_inefficiency(chains)

# %% [markdown]
# And both filters against the exact answer, in one picture: the 90 % interval of the position from particles (filled) and
# from chains (dashed) over Kalman's (solid), with the hole in grey.

# %%
picture = new_picture(9, 3.2)
axes = picture.add_subplot()
axes.axvspan(hidden.start - 0.5, hidden.stop - 0.5, color="0.93")
swarm, walked = (tree["summary/state_quantile"].sel(state_dim="position", quantile=[0.05, 0.95]) for tree in (result, chains))
exact = exact_mean[:, :1] + 1.645 * exact_sd[:, :1] * np.array([-1, 1])
axes.fill_between(range(NUM_FRAMES), *swarm.values.T, color="tab:blue", alpha=0.3, label="particles")
axes.plot(walked, "--", color="tab:orange", label=["chains", "_"])
axes.plot(exact, color="black", linewidth=0.8, label=["Kalman", "_"])
axes.plot(values, ".", color="tab:red", markersize=4, label="readings")
axes.set(xlabel="frame", ylabel="position")
axes.legend(ncols=4, frameon=False)
picture

# %% [markdown]
# ## What was claimed
#
# Each claim above, as a check that runs.

# %%
# a misspelt site is refused by name
assert "postion" in refusal
# the hole widens the interval, and the next readings narrow it again
deviation = result["summary/state_sd"].sel(state_dim="position").values
assert deviation[51] > 1.5 * deviation[39] and deviation[51] > 1.5 * deviation[79]
# fed frame by frame, the filter gives what it gives over the sequence
np.testing.assert_allclose(live, result["summary/state_mean"].sel(state_dim="position"), atol=1e-3)
# particles: means and evidence are Kalman's, and a wrong Kalman filter is found out
assert np.abs(apart).max() < 5 < np.abs(mistaken).max()
assert abs(evidence.sum() - exact_evidence.sum()) < 1.0
# chains: means within a fraction of a standard deviation of Kalman's, deviations within a fifth, and they mix well
off = (chains["summary/state_mean"].values - exact_mean) / exact_sd
assert np.sqrt(np.mean(off**2)) < 0.15 and np.abs(off).max() < 0.4
assert np.abs(chains["summary/state_sd"].values / exact_sd - 1).max() < 0.2
assert float(rhat.max()) < 1.05
# the coverage of the 90 % intervals of both is about nine tenths
for tree in (result, chains):
    low, high = (tree["summary/state_quantile"].sel(quantile=level).values for level in (0.05, 0.95))
    inside = (low < truth) & (truth < high)
    assert 0.75 < inside.mean() <= 1.0
