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
# # Five ways to sample one frame
#
# Everything that a tracker does happens within a frame: there is a prior, the prediction from the past, there are data,
# and it has to produce draws from their product. Here is one such frame, small enough to draw, and five ways to do it:
#
# 1. **importance sampling**: draw from the prior and weigh by the likelihood, as the bootstrap particle filter does;
# 2. **annealing** (Deutscher, Darby): layer after layer, the likelihood sharpens and the survivors are jittered;
# 3. **tempering**: the same idea done with weights and moves that leave each distribution invariant;
# 4. **differential evolution** (Du and Guan): particles move along differences of other particles;
# 5. **hybrid Monte Carlo** (Choo and Fleet): chains that roll along the gradient.
#
# The first and last three are asked for the same thing, the posterior. Annealing is asked for a good pose, and that is
# not the same: we shall see by how much.
#
# ## The frame
#
# Two numbers $a, b \sim \mathcal N(0, 1)$, and a measurement of $b + a^2$ with an error of 0.15. The posterior is a thin,
# bent ridge: a banana. In two dimensions a grid tells everything about it.

# %%
import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.toys.banana import banana

from poseppl.filters import annealed_filter, demc_filter, hmc_filter, particle_filter, tempered_filter
from poseppl.kernels import HMCSettings
from poseppl.report import new_picture

model = banana(curvature=1.0, noise=0.15).compile()
data = model.observe({"y": 1.0})

axis = np.linspace(-3.5, 3.5, 1401)
points = np.stack(np.meshgrid(axis, axis, indexing="ij"), -1).reshape(-1, 2)


@jax.jit
def log_posterior(x):
    return model.log_initial(x) + model.log_observation(x, data)


density = np.exp(np.asarray(jax.vmap(log_posterior)(jnp.asarray(points)), float))
log_evidence = np.log(density.sum() * (axis[1] - axis[0]) ** 2)
density /= density.sum()
exact_mean = density @ points
exact_spread = np.sqrt(density @ points**2 - exact_mean**2)
print(f"mean {exact_mean.round(3)}, standard deviations {exact_spread.round(3)}, log evidence {log_evidence:.3f}")

# %% [markdown]
# ## The five
#
# The first frame of a filter is exactly this problem, so `init` of five filters does it. `FilterInfo` counts what each of them
# spends, in evaluations of the likelihood and of its gradient, and says what it believes to be worth: the effective
# number of draws.

# %%
five = {
    "importance": particle_filter(model, 4000),
    "annealed": annealed_filter(model, 400, num_layers=10),
    "tempered": tempered_filter(model, 400),
    "DE-MC": demc_filter(model, 100, num_layers=40, target="posterior"),
    "HMC": hmc_filter(model, 20, HMCSettings(num_updates=60, num_leapfrog=40, num_warmup=20, step_size=0.2, jitter=0.5)),
}
REPEATS = 20


def weighted(state):
    particles = state.particles.reshape(-1, 2)
    return particles, jax.nn.softmax(state.log_weights.reshape(-1))


def once(filter, key):
    state, info = filter.init(key, data)
    particles, weights = weighted(state)
    mean = weights @ particles
    return state, info, mean, jnp.sqrt(weights @ (particles - mean) ** 2)


kept = {}
print(f"{'':>12} {'likelihoods':>12} {'gradients':>10} {'error of mean':>14} {'spread of a':>12} {'log evidence':>13}")
for name, filter in five.items():
    keys = jax.random.split(jax.random.key(0), REPEATS)
    states, infos, means, spreads = jax.lax.map(lambda key, filter=filter: once(filter, key), keys)
    error = np.sqrt(np.mean(np.sum((np.asarray(means) - exact_mean) ** 2, 1)))
    kept[name] = jax.tree.map(lambda leaf: leaf[0], states), error, np.asarray(spreads).mean(0), np.asarray(infos.log_evidence)
    print(
        f"{name:>12} {int(infos.num_likelihood[0]):>12} {int(infos.num_gradient[0]):>10} {error:>14.3f} "
        f"{kept[name][2][0]:>12.3f} {kept[name][3].mean():>13.2f}"
    )
print(f"{'exact':>12} {'':>12} {'':>10} {'':>14} {exact_spread[0]:>12.3f} {log_evidence:>13.2f}")

# %% [markdown]
# ## The picture
#
# Grey is the posterior. Importance sampling puts one draw in twenty on the ridge and wastes the rest; what it gets is
# right. Annealing gathers at a spot of the ridge and calls it a day. Tempering, differential evolution and HMC cover it
# end to end.

# %%
figure = new_picture(13, 3)
for axes, (name, (state, *_)) in zip(figure.subplots(1, 5, sharey=True), kept.items(), strict=True):
    axes.contourf(axis, axis, density.reshape(len(axis), -1).T, cmap="Greys")
    particles, weights = weighted(state)
    chosen = np.random.default_rng(0).choice(
        len(particles), 400, p=np.asarray(weights, float) / np.sum(np.asarray(weights, float))
    )
    axes.plot(*np.asarray(particles)[chosen].T, ".", markersize=3, color="tab:red")
    axes.set(title=name, xlabel="a", xlim=(-2.5, 2.5), ylim=(-3.5, 1.5))
figure.axes[0].set_ylabel("b")
figure

# %% [markdown]
# ## What to take home
#
# In two dimensions any exact method will do, and the cheapest is the simplest. The order turns around as dimensions are
# added: the share of prior draws on the ridge falls exponentially, while the moves only get a little shorter. Annealing is
# quick at finding a mode, and its spread says nothing about what the data leave open. And HMC is only as good as its steps:
# they have to fit the sharpest bend, and the trajectories the whole ridge. Make the ridge three times thinner
# (`noise=0.05`): these 20 chains, started at the few prior draws near it, do not get round the bend in 60 updates. Tempering
# carries its particles along as the ridge narrows, and is not affected.

# %%
scale = np.linalg.norm(exact_spread)
for name in ("importance", "tempered", "DE-MC", "HMC"):
    _, error, spread, _ = kept[name]
    assert error < 0.35 * scale, name
    assert np.abs(spread / exact_spread - 1).max() < 0.15, name
assert kept["annealed"][2][0] < 0.8 * exact_spread[0]
for name in ("importance", "tempered"):
    estimates = kept[name][3]
    assert abs(estimates.mean() - log_evidence) < 5 * estimates.std(ddof=1) / np.sqrt(REPEATS) + estimates.var()
