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
# # Your cameras, step by step
#
# Four phones film a person, a detector finds the joints in each picture, and you want 3-D joints and angles for OpenSim, and to
# know how far to trust each. This goes from the calibration to the files that OpenSim reads. No recording is needed: a walk is
# drawn through four cameras, with a detector's errors, so that in the end all of it can be held against the truth.

# %%
import json
import os
import tempfile
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.motion.bodies.opensim import opensim_values
from poseppl.motion.geometry import project
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.io import read_cameras, write_cameras
from poseppl.motion.io.keypoint_layouts import LAYOUTS, markers_of_names
from poseppl.motion.io.opensim_files import read_mot
from poseppl.motion.io.trc import read_trc
from poseppl.motion.keypoints.scene import scene_of_keypoints
from poseppl.motion.keypoints.settings import KeypointSettings
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.report import plot_pose3d
from poseppl.motion.tracking import SmoothSettings, TrackSettings, smooth, track
from poseppl.motion.tracking.estimates import angle_estimates
from poseppl.motion.tracking.export import export
from poseppl.motion.tracking.placing import cameras_around, cameras_of_records, records_of_cameras
from poseppl.report import new_picture, save_picture


def shown(picture, name):
    """A picture, which the page "your cameras, step by step" shows, too."""
    if "POSEPPL_PICTURES" in os.environ:
        save_picture(picture, Path(os.environ["POSEPPL_PICTURES"]) / f"{name}.png")
    return picture


folder = Path(tempfile.mkdtemp(prefix="poseppl-"))
rng = np.random.default_rng(0)
walker = walking_subject(frames="0:40")  # a second and a third at 30 frames a second

# %% [markdown]
# ## 1. Calibrate: a checkerboard
#
# Film a checkerboard, better a ChArUco board, that is moved through the room, with all cameras at once, and let one of
# [anipose](https://anipose.readthedocs.io), [Pose2Sim](https://github.com/perfanalytics/pose2sim) or
# [caliscope](https://github.com/mprib/caliscope) find the cameras; their TOML files are read as they are. The board has to be
# seen by every two neighbours at the same time, near the corners of the picture as well, and tilted. Then do not touch the
# cameras.
#
# Here the file is written from cameras that are known. Somebody has touched one all the same: it was turned by a degree after
# the calibration, of which the file does not know.

# %%
truth = records_of_cameras(cameras_around(walker, count=4), focal=1000.0, size=(1280, 960))
calibrated = list(truth)
bumped = Rotation.from_rotvec(np.radians([0.3, 0.9, 0.3])).as_matrix()
calibrated[2] = truth[2]._replace(rotation=bumped @ truth[2].rotation, translation=bumped @ truth[2].translation)
write_cameras(folder / "Calib.toml", calibrated)
print((folder / "Calib.toml").read_text()[:170])

# %% [markdown]
# ## 2. Detect: points in each picture
#
# Run OpenPose, RTMPose or another detector on each video; for OpenPose `openpose --video cam1.mp4 --write_json pose/cam1
# --display 0`. Its points are off by some pixels, in the same direction for some frames, and now and then far off. Such
# errors are drawn here, from the model that the smoother assumes (`poseppl_models.bodies.detected_points`): half of the
# variance lasts for half a second, the other half is Student-t with 4 degrees of freedom; and one point in thirty is not
# found at all.

# %%
layout = LAYOUTS["body25"]
found_by = {name: number for name, number in markers_of_names(layout).items() if name in walker.body.tree.marker_names}
places = walker.markers[:, [walker.body.tree.marker_names.index(name) for name in found_by]]
exact = np.moveaxis(np.asarray(project(cameras_of_records(truth), jnp.asarray(places, float)), np.float64), 0, 1)
NOISE, DEGREES = 4.0, 4.0

confidence = rng.uniform(0.5, 1.0, exact.shape[:3])
kept = np.exp(-1 / walker.rate / 0.5)
lasting = rng.normal(size=exact.shape)
for t in range(1, len(lasting)):
    lasting[t] = kept * lasting[t - 1] + np.sqrt(1 - kept**2) * lasting[t]
heavy = rng.normal(size=exact.shape) * np.sqrt(DEGREES / rng.chisquare(DEGREES, (*exact.shape[:3], 1)))
heavy *= np.sqrt((DEGREES - 2) / DEGREES)
detected = exact + NOISE / np.sqrt(confidence)[..., None] * (np.sqrt(0.5) * lasting + np.sqrt(0.5) * heavy)
absent = rng.uniform(size=exact.shape[:3]) < 1 / 30

folders = {}
for c, record in enumerate(truth):
    folders[record.name] = folder / "pose" / record.name
    folders[record.name].mkdir(parents=True)
    for t in range(len(exact)):
        person = np.zeros((len(layout), 3))  # a point that is not found is 0, 0 with confidence 0
        person[list(found_by.values())] = np.where(
            absent[t, c, :, None], 0.0, np.concatenate([detected[t, c], confidence[t, c, :, None]], -1)
        )
        text = json.dumps({"people": [{"pose_keypoints_2d": person.round(3).ravel().tolist()}]})
        (folders[record.name] / f"{record.name}_{t:012d}_keypoints.json").write_text(text)
print(len(list(folder.rglob("*.json"))), "files")

# %% [markdown]
# ## 3. Look: who is who, which camera is off
#
# On the command line all that follows is
#
#     poseppl track keypoints camera_1=pose/camera_1 camera_2=pose/camera_2 ... --calibration Calib.toml --rate 30
#
# Before it tracks, it reports on the cameras. The one that was touched is named, and its pose is corrected:

# %%
found = scene_of_keypoints(KeypointSettings(folders, read_cameras(folder / "Calib.toml"), rate=walker.rate, layout="body25"))
for note in found.notes():
    print(note)
turned = np.degrees(np.linalg.norm(found.refined.turn, axis=-1))
print({name: f"{degrees:.1f} degrees" for name, degrees in zip(found.scene.camera_names, turned, strict=True)})

# %% [markdown]
# ## 4. Track, then smooth
#
# The filter gives each frame, given those before it; the smoother each frame given all. The smoother takes the detector's
# errors as they are, lasting and heavy-tailed.

# %%
filtered = track(found.scene, TrackSettings(filter="kalman", max_draws=200)).result
smoothed = smooth(filtered, SmoothSettings("laplace", errors="lasting", max_draws=300))

# %%
shown(plot_pose3d(smoothed, 20), "your_cameras_pose")

# %% [markdown]
# ## 5. Export, and read it back
#
# `NAME.trc` has the mean places, `_lower` and `_upper` the ends of the 90 % intervals; joints that no camera saw are left out.
# `NAME.mot` has joint angles under OpenSim's names. `poseppl export walk.nc` writes them again, with `--format c3d csv` for
# other formats. In OpenSim the TRC is for inverse kinematics, and the MOT is loaded as a motion, File > Load Motion.

# %%
files = export(smoothed, folder, "walk")
joints, lower, upper = (read_trc(path) for path in files[:3])
angles = read_mot(files[3])
print([path.name for path in files])
print(joints.positions.shape, joints.rate, "frames a second;", len(angles.columns), "columns of angles")

# %% [markdown]
# ## 6. How good is it?
#
# The result is compared with the truth, and with weighted linear triangulation. That has the same corrected cameras, but no
# body, no motion and no intervals. If a camera was touched, the pictures do not show whether it moved, or the others and the
# room. The corrected cameras, and the person with them, are therefore a little beside their true positions. Angles do not
# depend on this; positions do, and their intervals include it. Positions are compared directly, and after the whole walk is
# laid onto the truth by one turn and one shift. After the shift the intervals are wider than necessary.

# %%
written, of_body = ([names.index(name) for name in found_by] for names in (joints.names, walker.body.tree.marker_names))
straight = triangulate(found.scene.cameras, found.scene.data.points, 1 / np.square(found.scene.data.noise))[:, of_body]
true_places = walker.markers[:, of_body]
ours = joints.positions[:, written]
turn, _ = Rotation.align_vectors(
    (ours - ours.mean((0, 1))).reshape(-1, 3), (true_places - true_places.mean((0, 1))).reshape(-1, 3)
)
laid = turn.apply((true_places - true_places.mean((0, 1))).reshape(-1, 3)).reshape(true_places.shape) + ours.mean((0, 1))
print(f"our room is turned by {np.degrees(turn.magnitude()):.2f} degrees")


def errors(estimate, known):
    """Distances of the joints that the detector finds from known places, mm."""
    return np.linalg.norm(estimate - known, axis=-1)


for name, estimate in (("triangulated", straight), ("smoothed", ours)):
    for where, known in (("in the room", true_places), ("laid onto the truth", laid)):
        off = errors(estimate, known)
        print(f"{name}, {where}: median {np.nanmedian(off):.1f} mm, 95th percentile {np.nanpercentile(off, 95):.1f} mm")

low, high = np.minimum(lower.positions, upper.positions)[:, written], np.maximum(lower.positions, upper.positions)[:, written]
held_in_room, held_laid = (((low <= known) & (known <= high)).mean() for known in (true_places, laid))
print(f"coverage of 90 % intervals of positions: {held_in_room:.0%} in the room, {held_laid:.0%} laid onto the truth")

# %%
coordinates, estimated = angle_estimates(smoothed)
names = [each.name for each in coordinates]
true_angles = np.asarray(opensim_values(walker.body, jnp.asarray(walker.states, float)))
chosen = [names.index(name) for name in ("knee_angle_r", "knee_angle_l", "hip_flexion_r", "hip_flexion_l", "elbow_flex_r")]
held = (estimated.lower <= true_angles) & (true_angles <= estimated.upper)
off = np.abs(estimated.mean - true_angles)
print({names[k]: f"{off[:, k].mean():.1f} degrees off, {held[:, k].mean():.0%} held" for k in chosen})

# %%
picture = new_picture(9, 5)
upper_axes, lower_axes = picture.subplots(2, 1, sharex=True)
seconds, knee = angles.times, names.index("knee_angle_r")
upper_axes.fill_between(seconds, estimated.lower[:, knee], estimated.upper[:, knee], alpha=0.3, label="90 % interval")
upper_axes.plot(seconds, angles.columns["knee_angle_r"], label="NAME.mot")
upper_axes.plot(seconds, true_angles[:, knee], color="black", linewidth=1, label="truth")
upper_axes.set(ylabel="knee_angle_r, degrees", title="A knee that four cameras saw")
upper_axes.legend(frameon=False, loc="upper left")
ankle = list(found_by).index("ankle_r")
lower_axes.fill_between(seconds, low[:, ankle, 2], high[:, ankle, 2], alpha=0.3)
lower_axes.plot(seconds, ours[:, ankle, 2])
lower_axes.plot(seconds, laid[:, ankle, 2], color="black", linewidth=1)
lower_axes.plot(seconds, straight[:, ankle, 2], ".", color="grey", markersize=4, label="triangulated")
lower_axes.legend(frameon=False, loc="upper left")
lower_axes.set(ylabel="height of ankle_r, mm", xlabel="s")
shown(picture, "your_cameras")
picture

# %% [markdown]
# ## Low confidence
#
# `poseppl report walk.nc` lists the joints and frames of low confidence with reasons, and shows each camera's errors.
# BODY_25 has no point on the head but those of the face, so the head's position comes from the body model alone:

# %%
from poseppl.motion.verdicts.doubts import doubts_in_a_row, doubts_of

for span in doubts_in_a_row(smoothed, doubts_of(smoothed))[:5]:
    print(f"{', '.join(span.joints)}, frames {span.first} to {span.last}: {span.reason}")

# %% [markdown]
# ## What was claimed

# %%
assert any(note.startswith("camera_3: its calibration is off by") for note in found.notes())
assert abs(turned[2] - 1.0) < 0.4 and turned[[0, 1, 3]].max() < 0.5
for known in (true_places, laid):
    assert np.nanmedian(errors(ours, known)) < np.nanmedian(errors(straight, known)) < 40.0
assert held_in_room > 0.85 and held_laid > 0.9
assert off[:, chosen].mean() < 5.0 and held[:, chosen].mean() > 0.75
np.testing.assert_allclose(ours, smoothed["summary/markers_mean"][:, of_body], atol=0.01)
assert not any(np.isnan(values).any() for values in angles.columns.values())
