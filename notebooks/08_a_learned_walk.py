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
# # What a walk looks like from inside
#
# One camera leaves the depth of a limb open, and a random walk says little of it. Recordings of people who walk say more.
# Here an activity is learned from recordings, as Darby, Li and Costen (2008) do, and given to a tracker as its prior. Then
# the person does something else, and we see whether the prior misleads the tracker.
#
# ## People to learn from
#
# Recordings would come from files (`poseppl fit-motion walk FILES...`). Here four people are made of the built-in walk: each
# holds every joint a little otherwise, and moves with some noise. A fifth is kept for later.

# %%
import tempfile
from pathlib import Path

import numpy as np

from poseppl.diagnostics.verdicts import verdicts
from poseppl.motion.learned import PosedRecording, TrainingSettings, train_motion_model, write_motion_model
from poseppl.motion.learned.states_picture import plot_states
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import TrackSettings, observe_motion, track
from poseppl.motion.tracking.default_body import DEFAULT_MODEL
from poseppl.motion.tracking.placing import camera_names, cameras_around
from poseppl.report import new_picture

walker = walking_subject(frames="0:120")
tree = walker.body.tree
angles = np.array([name[-1] in "XYZ" for name in tree.coordinate_names])
rng = np.random.default_rng(0)


def somebody():
    """The walk (T, d) of a person: held otherwise by 3 degrees, with noise of half a degree."""
    held = rng.normal(0.0, np.radians(3.0), len(angles))
    return walker.states + angles * (held + rng.normal(0.0, np.radians(0.5), walker.states.shape))


recordings = [
    PosedRecording(somebody(), tree.coordinate_names, tree.joint_names[0], walker.rate, f"person {number}", "made here", 0.0)
    for number in range(4)
]
stranger = somebody()

# %% [markdown]
# ## The cycle
#
# Each person's angles, without their mean, are projected on their principal components. A hidden Markov model learns how
# these follow each other: its states are phases of the walk.

# %%
model = train_motion_model(recordings, DEFAULT_MODEL, TrainingSettings(num_states=12))
print(f"{model.components.shape[1]} components keep {model.explained:.0%} of the variance of {len(model.learned)} angles")
stays = np.diagonal(model.transition)
print(f"a phase lasts {np.median(1 / (1 - stays)):.1f} frames, at the median")

# %%
plot_states(model, [(each.person, model.features(each.states, each.person)) for each in recordings])

# %% [markdown]
# The cycle is a closed curve, and the states lie along it. They follow each other as the curve goes:

# %%
picture = new_picture(8, 3)
axes = picture.subplots()
features = model.features(stranger)
apart = [
    np.einsum("ti,ij,tj->t", features - mean, np.linalg.inv(covariance), features - mean)
    for mean, covariance in zip(model.means, model.covariances, strict=True)
]
axes.step(np.arange(len(stranger)) / walker.rate, np.argmin(apart, 0), color="black")
axes.set(xlabel="s", ylabel="nearest phase", title="Phases of the stranger's walk")
picture

# %% [markdown]
# ## One camera, with and without the prior
#
# The stranger is seen by one camera, as points with noise of 3 px. From frame 60 on the arms are raised sideways, by up
# to 90 degrees, and are lowered again: nothing of what was learned.

# %%
frames = np.arange(len(stranger))
raised = np.radians(90) * np.interp(frames, [60, 75, 90, 105], [0.0, 1.0, 1.0, 0.0])
waving = stranger.copy()
names = list(tree.coordinate_names)
for side, sign in (("l", 1), ("r", -1)):
    waving[:, names.index(f"shoulder_{side}.X")] += sign * raised
    waving[:, names.index(f"elbow_{side}.X")] += 0.5 * raised
subject = walker._replace(states=waving, markers=walker.body.places(waving))
scene = observe_motion(subject, cameras_around(subject, count=1), camera_names(1), noise=0.003)

with tempfile.TemporaryDirectory() as folder:
    prior = str(Path(folder) / "walk.nc")
    write_motion_model(model, prior)
    results = {
        "no prior": track(scene).result,
        "activity alone": track(scene, TrackSettings(filter="switching", prior=prior, other_motion=False)).result,
        "activity or other motion": track(scene, TrackSettings(filter="switching", prior=prior)).result,
    }


def error(tree):
    """Mean distance of the joints from the truth (frame,), mm."""
    return np.linalg.norm(tree["summary/markers_mean"].values - tree["truth/markers"].values, axis=-1).mean(1)


other = (frames >= 65) & (frames < 100)
for name, tree_of in results.items():
    print(
        f"{name}: {error(tree_of)[frames < 60].mean():.0f} mm walking, {error(tree_of)[other].mean():.0f} mm with raised arms"
    )

# %%
picture = new_picture(8, 5)
upper, lower = picture.subplots(2, 1, sharex=True)
for name, tree_of in results.items():
    upper.plot(frames, error(tree_of), label=name)
upper.set(ylabel="error, mm")
upper.legend(frameon=False)
probability = results["activity or other motion"]["summary/prior_mean"].values
lower.plot(frames, probability, color="black")
lower.axvspan(60, 105, color="grey", alpha=0.2)
lower.set(xlabel="frame", ylabel="P(activity)", ylim=(-0.03, 1.03))
picture

# %% [markdown]
# The grey frames are those of raised arms. With the activity alone the prior drags the arms down; with other motion beside it
# the probability falls, and the verdicts name the frames:

# %%
for verdict in verdicts(results["activity or other motion"]):
    print(f"{verdict.severity}: {verdict.text}")
