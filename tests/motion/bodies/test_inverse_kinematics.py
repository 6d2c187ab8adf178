from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest
from poseppl_models.bodies.choo_fleet import full_body
from poseppl_models.bodies.gait import walk

from poseppl.errors import InputError
from poseppl.motion.bodies.inverse_kinematics import fit_states
from poseppl.motion.bodies.subject import fit_subject, match_markers
from poseppl.motion.geometry import marker_positions
from poseppl.motion.io import Motion, read_motion, slice_frames

# recording, its skeleton, and the mean distance in mm that the body must reach (what it reached, and a millimetre)
RECORDINGS = {
    "02_01": ("cmu_amc/02_01.amc", "cmu_amc/02.asf", 4.8),
    "03_01": ("cmu_amc/03_01.amc", "cmu_amc/03.asf", 8.1),
    "bvh": ("pybvh/cmu_12_01_walk.bvh", None, 7.1),
    "makehuman": ("makehuman/walk1.bvh", None, 6.1),
}


@pytest.fixture(scope="module")
def walker():
    """A body, its states over one second and their markers."""
    states, lengths = walk(rate=30.0, num_frames=30)
    body = full_body(lengths)
    markers = jax.vmap(lambda x: marker_positions(body.tree, x))(states.astype(np.float32))
    return body, states, np.asarray(markers, np.float64)


@pytest.mark.full
def test_the_bodys_own_markers_come_back(walker):
    """The pulls bias what the markers show by less than a tenth of a millimetre."""
    body, states, markers = walker
    found, residual = fit_states(body.tree, markers, body.rest)
    assert residual.shape == markers.shape[:2] and residual.mean() < 0.05 and residual.max() < 0.5
    shown = [i for i, (joint, axis) in enumerate(body.tree.coordinates) if (joint, axis) != ("head", "Z")]
    np.testing.assert_allclose(found[:, shown], states[:, shown], atol=0.3)
    np.testing.assert_allclose(found[:, :3], states[:, :3], atol=0.3)


@pytest.mark.full
def test_any_heading_and_no_jumps(walker):
    """A walker turned by any angle keeps his joint angles, and his heading goes on past pi."""
    body, states, markers = walker
    reference, _ = fit_states(body.tree, markers[:1], body.rest)
    for turn in (0.5, 2.0, 3.1, -2.5):
        c, s = np.cos(turn), np.sin(turn)
        found, residual = fit_states(body.tree, markers[:1] @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), body.rest)
        assert residual.max() < 0.5
        np.testing.assert_allclose(found[0, 4:], reference[0, 4:], atol=1e-2)
    turns = np.linspace(0, 3 * np.pi, 30)
    spin = np.stack([[[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]] for a in turns])
    found, residual = fit_states(body.tree, markers[:1] @ spin, body.rest)
    assert np.abs(np.diff(found[:, 3:], axis=0)).max() < 0.5 and residual.max() < 1.0
    np.testing.assert_allclose(found[-1, 3] - found[0, 3], 3 * np.pi, atol=0.1)


def swung(walker, angles, leaps):
    """The left shoulder's angles as they are and as they are found, and residuals, of a body that leaps by so many 300 mm."""
    body, states, _ = walker
    path = np.repeat(states[:1], len(angles), axis=0)
    shoulder = [i for i, (joint, _) in enumerate(body.tree.coordinates) if joint == "shoulder_l"]
    path[:, shoulder] = angles
    path[:, 1] += 300.0 * leaps
    markers = jax.vmap(lambda x: marker_positions(body.tree, x))(path.astype(np.float32))
    found, residual = fit_states(body.tree, np.asarray(markers, np.float64), body.rest)
    return path[:, shoulder], found[:, shoulder], residual


@pytest.mark.full
def test_no_other_angles_for_the_same_rotation_after_a_leap(walker):
    """An arm that swings past the pole of its angles, on a body that leaps: no angle jumps by pi."""
    _, found, residual = swung(walker, np.linspace([1.8, -1.0, -1.0], [1.6, -2.4, -0.8], 8), np.arange(8))
    assert residual.max() < 2.0  # rest draws an arm of 500 mm by 1/2500 of 2 rad
    assert np.abs(np.diff(found, axis=0)).max() < 0.5


def test_the_angles_of_an_arm_go_on_through_leaps(walker):
    """An arm that has come back to where it hung by half a turn about each axis; from rest it is found by angles near zero.

    The same rotation has other angles, which are within half a turn of those before.
    """
    angles = np.linspace([0.3, -0.3, -0.2], [2.9, -2.8, -2.6], 16)
    path, found, residual = swung(walker, angles, np.maximum(np.arange(16) - 11, 0))
    assert residual[12:].max() < 0.2
    np.testing.assert_allclose(found[12:], path[12:], atol=0.02)


@pytest.mark.full
def test_missing_markers(walker):
    """A marker, a limb, a whole frame: what is left decides, and what nothing shows stays as it was."""
    body, _, markers = walker
    names = body.tree.marker_names
    holes = markers.copy()
    holes[3:6, names.index("knee_l")] = np.nan
    holes[8:12, [names.index("elbow_r"), names.index("wrist_r")]] = np.nan
    holes[15] = np.nan
    holes[0] = np.nan
    found, residual = fit_states(body.tree, holes, body.rest)
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(np.isnan(residual), np.isnan(holes).any(-1))
    assert np.nanmax(residual) < 1.0
    elbow = body.tree.coordinate_names.index("elbow_r.X")
    assert np.abs(np.diff(found[7:12, elbow])).max() < 0.1
    assert np.abs(found[15] - found[14]).max() < 0.2
    clean, _ = fit_states(body.tree, markers, body.rest)
    np.testing.assert_allclose(found[20:], clean[20:], atol=0.5)


def test_refuses(walker):
    body, _, markers = walker
    with pytest.raises(ValueError, match=r"expected \(T, 17, 3\)"):
        fit_states(body.tree, markers[:, :5])
    with pytest.raises(ValueError, match="expected"):
        fit_states(body.tree, markers[:0])
    with pytest.raises(ValueError, match=r"expected \(28,\)"):
        fit_states(body.tree, markers, np.zeros(27))
    with pytest.raises(ValueError, match="no frame has a marker"):
        fit_states(body.tree, np.full_like(markers, np.nan))


@pytest.mark.full
@pytest.mark.parametrize("name", RECORDINGS)
def test_recordings(data_dir, name):
    """Every tenth of a second: close to the joints, knees bend backwards and elbows forwards."""
    path, skeleton, limit = RECORDINGS[name]
    motion = read_motion(data_dir / path, skeleton and data_dir / skeleton)
    if len(motion.positions) > 100:
        motion = slice_frames(motion, f"1:{len(motion.positions)}:12")
    subject = fit_subject(motion, full_body)
    assert subject.residual < limit
    coordinates = subject.body.tree.coordinate_names
    for side in "lr":
        assert subject.states[:, coordinates.index(f"knee_{side}.X")].max() < 0.05
        assert subject.states[:, coordinates.index(f"elbow_{side}.X")].min() > -0.05
    assert np.abs(np.diff(subject.states[:, 3:], axis=0)).max() < 1.5


@pytest.mark.full
def test_skin_markers_stand_for_joints(data_dir):
    motion = slice_frames(read_motion(data_dir / "btk_c3d" / "PiG_Motion-FlatFoot-Full.c3d"), "0:300:10")
    subject = fit_subject(motion, full_body)
    assert subject.residual < 10
    assert 350 < subject.body.lengths["thigh"] < 450


def test_too_few_points_are_refused(data_dir):
    whole = read_motion(data_dir / "btk_c3d" / "PiG_Motion3_FF.c3d")
    kept = [i for i, name in enumerate(whole.names) if not name.endswith(("KNE", "ANK"))]
    hips = replace(whole, names=tuple(whole.names[i] for i in kept), positions=whole.positions[:, kept])
    with pytest.raises(InputError, match="PiG_Motion3_FF.c3d.*too few for the body: no neck, shoulder_l"):
        fit_subject(hips, full_body)
    strange = Motion(("a", "b"), np.ones((4, 2, 3)), (), 100.0, "strange.c3d")
    with pytest.raises(InputError, match="none of its 2 points .a, b. is a joint of the body.*joint centres such as root"):
        fit_subject(strange, full_body)
    motion = Motion(("Hips", "Neck"), np.ones((4, 2, 3)), (), 100.0, "few.c3d")
    assert match_markers(motion, ("pelvis", "knee_l"), full_body().aliases).shape == (4, 2, 3)
    with pytest.raises(InputError, match="too few for the body: no hip_l, hip_r.*points for .*hip_l.*; name them with names="):
        fit_subject(motion, full_body)


@pytest.mark.full
def test_legs_alone_are_a_body_in_proportion(data_dir):
    """The upper body is at rest, as large as the legs say."""
    motion = slice_frames(read_motion(data_dir / "btk_c3d" / "PiG_Motion3_FF.c3d"), "0:290:29")
    subject = fit_subject(motion, full_body)
    assert subject.residual < 6
    seen = np.isfinite(subject.markers).all(-1).any(0)
    names = subject.body.tree.marker_names
    assert {name for name, there in zip(names, seen, strict=True) if there} == {
        "pelvis", "hip_l", "hip_r", "knee_l", "knee_r", "ankle_l", "ankle_r"
    }  # fmt: skip
    lengths, standard = subject.body.lengths, full_body().lengths
    size = (lengths["thigh"] + lengths["shank"]) / (standard["thigh"] + standard["shank"])
    assert lengths["upper_arm"] / standard["upper_arm"] == pytest.approx(size)
    assert np.abs(subject.states[:, subject.body.tree.coordinate_names.index("elbow_l.X")]).max() < 0.5


def test_names_are_compared_without_case_and_punctuation_where_none_fits():
    places = np.arange(4 * 3.0).reshape(1, 4, 3)
    motion = Motion(("mixamorig:LeftLeg", "thigh.L", "LFoot", "l_foot"), places, (), 100.0, "rig.bvh")
    found = match_markers(motion, ("knee_l", "hip_l", "ankle_l"), full_body().aliases)
    np.testing.assert_array_equal(found[0, :2], places[0, :2])
    assert np.isnan(found[0, 2]).all()  # two points are called lfoot
    lone = replace(motion, names=("head", "a", "b", "c"))
    found = match_markers(lone, ("skull", "crown"), {"skull": ("Head",), "crown": ("head",)})
    np.testing.assert_array_equal(np.isfinite(found[0]).all(-1), [True, False])  # one point, one marker


def test_a_prefix_that_names_share_is_none_of_the_name():
    places = np.arange(5 * 3.0).reshape(1, 5, 3)
    for prefix in ("Actor_", "Armature|", "Subject 1:", "S:Bip01_"):
        names = tuple(prefix + name for name in ("Hips", "Neck", "L_Thigh", "R_Thigh", "L_UpperArm"))
        motion = Motion(names, places, (), 100.0, "rig.bvh")
        found = match_markers(motion, ("pelvis", "neck", "hip_l", "hip_r"), full_body().aliases)
        np.testing.assert_array_equal(found[0], places[0, :4])


def test_cmus_names_of_the_waist_are_those_of_plug_in_gait():
    places = np.arange(4 * 3.0).reshape(1, 4, 3)
    motion = Motion(("LFWT", "RFWT", "LBWT", "RBWT"), places, (), 120.0, "cmu.c3d")
    found = match_markers(motion, ("pelvis", "hip_l"), full_body().aliases)
    np.testing.assert_array_equal(found[0, 0], places[0].mean(0))
    thigh = replace(motion, names=(*motion.names, "LTHI"), positions=np.append(places, [[[1.0, 2.0, 3.0]]], 1))
    hip = match_markers(thigh, ("hip_l",), full_body().aliases)[0, 0]
    np.testing.assert_allclose(hip, (2 * places[0, 0] + 2 * places[0, 2] + [1, 2, 3]) / 5)


@pytest.mark.full
def test_given_names_come_first():
    places = np.arange(4 * 3.0).reshape(1, 4, 3)
    motion = Motion(("Hips", "LeftLeg", "X1", "X2"), places, (), 100.0, "rig.bvh")
    found = match_markers(motion, ("pelvis", "knee_l"), full_body().aliases, {"knee_l": ("X1", "X2")})
    np.testing.assert_array_equal(found[0], [places[0, 0], places[0, 2:].mean(0)])
    with pytest.raises(InputError, match="the body has no marker 'knee'"):
        match_markers(motion, ("pelvis",), full_body().aliases, {"knee": ("X1",)})
    with pytest.raises(InputError, match="rig.bvh: there is no 'X3'"):
        match_markers(motion, ("pelvis",), full_body().aliases, {"pelvis": ("X3",)})
