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
# # Choosing a sampler by its inefficiency factor
#
# A Markov chain of $N$ draws estimates a mean with the variance
#
# $$\operatorname{Var}[\hat\mu] = \frac{\tau}{N} \operatorname{Var}[x],$$
#
# $\tau$ being the *inefficiency factor*: so many draws are worth one independent draw (Choo and Fleet 2001, Eq. 8). It is
# what to look at when a sampler has settings, and hybrid Monte Carlo has three: the step size $\epsilon$, the number $L$
# of leapfrog steps between two draws, and the number $b$ of draws thrown away before the chain has settled.
#
# Here we choose them for one frame of a walk, seen by one camera: the 10-D tracker of pelvis, hips and knees, whose prior
# is one step of a random walk from the frame before.
#
# ## Runs
#
# Eight chains for three trajectory lengths and a range of step sizes, three times over; all with the same number of
# gradients, so that short trajectories get more updates. `tune` runs them and measures what matters.

# %%
import numpy as np
from poseppl_papers.choo_fleet.figures import draw_tuning
from poseppl_papers.choo_fleet.tuning import TuningRuns, choose, tune, tuning_tables
from poseppl_papers.recordings import BUILT_IN

STEP_SIZES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
jobs = [TuningRuns(BUILT_IN, "lower_body", leapfrog, STEP_SIZES, 960 // leapfrog, 3) for leapfrog in (1, 5, 20)]
results = {job.key: tune(job) for job in jobs}
tables = tuning_tables(jobs, results)

# %% [markdown]
# ## What a short step costs, and a long one
#
# The rejection rate says whether the leapfrog steps follow the posterior's slopes: near zero they are needlessly short,
# and where it shoots up they are too long for the sharpest direction. It does not say which *length of trajectory* is
# best; $\tau$ does. And since a draw costs $L$ gradients, what to make small is $\tau L$, the gradients that an independent
# draw costs.

# %%
mixing = tables[0]
print(f"{'L':>3} {'step size':>10} {'rejected':>9} {'tau':>7} {'gradients a draw':>17}")
for row in mixing.records():
    shown = f"{row['leapfrog']:>3} {row['step_size']:>10} {row['rejection']:>9.0%}"
    print(f"{shown} {row['tau']:>7.1f} {row['gradients_per_draw']:>17.0f}")

# %% [markdown]
# ## The pictures
#
# Top left, the rejection rate with the 15 % that the paper recommends; top right, gradients an independent draw. Below, at
# the step size that was chosen: the autocorrelation, whose sum $\tau$ is, and the largest $\hat R$ of the 16 updates after a
# burn-in. One leapfrog step is a random walk: its draws remember for dozens of updates.

# %%
draw_tuning({table.name: table for table in tables})

# %% [markdown]
# ## The choice
#
# The cheapest setting whose chains do not stick, and the first burn-in after which $\hat R$ stays below 1.2, which 16
# updates of eight chains reach by chance.

# %%
chosen = choose(tables)
print(", ".join(f"{name} {value}" for name, value in chosen.items()))

# %% [markdown]
# ## What to take home
#
# Long trajectories pay although each draw costs more, as long as steps are short enough not to be rejected. Rejection climbs
# suddenly: a fixed step size wants a margin, or adapt it (`target_acceptance=0.85` adapts it in every frame's warm-up). And
# $\tau$ of a chain that has not found all modes looks splendid: look at $\hat R$ of several chains, at coverage where the truth
# is known, and compare whole runs with `poseppl compare`.

# %%
moving = [row for row in mixing.records() if row["rejection"] <= 0.3]
cost = {
    leapfrog: np.nanmin([row["gradients_per_draw"] for row in moving if row["leapfrog"] == leapfrog]) for leapfrog in (1, 5, 20)
}
assert chosen["leapfrog"] > 1 and cost[1] > 2 * cost[chosen["leapfrog"]]
rejections = mixing.column("rejection", leapfrog=20)
assert rejections[0] < 0.05 < rejections[-1]
