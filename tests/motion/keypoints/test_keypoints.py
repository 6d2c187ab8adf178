"""A detector's keypoints of real recordings: who is who, and cameras whose calibration is off."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.choo_fleet import full_body
from scipy.spatial.transform import Rotation

from poseppl.errors import InputError
from poseppl.motion.geometry import project
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.io import CameraRecord, read_cameras
from poseppl.motion.io.json_detectors import read_openpose
from poseppl.motion.io.keypoint_layouts import markers_of_names
from poseppl.motion.keypoints.camera_errors import camera_errors
from poseppl.motion.keypoints.camera_refinement import PRIOR_ANGLE, PRIOR_POSITION, bundle_adjust
from poseppl.motion.keypoints.people import associate_person
from poseppl.motion.keypoints.scene import check_markers, scene_of_keypoints
from poseppl.motion.keypoints.settings import KeypointSettings
from poseppl.motion.tracking.placing import cameras_of_records


@pytest.fixture
def records(data_dir: Path) -> tuple[CameraRecord, ...]:
    return read_cameras(data_dir / "pose2sim_balancing" / "calibration" / "Calib_qualisys.toml")


@pytest.fixture
def folders(data_dir: Path) -> dict[str, Path]:
    return {f"cam_0{c}": data_dir / "pose2sim_balancing" / "pose" / f"cam0{c}_json" for c in (1, 2, 3, 4)}


def turned(record: CameraRecord, degrees: Sequence[float]) -> CameraRecord:
    turn = Rotation.from_rotvec(np.deg2rad(degrees)).as_matrix()
    return record._replace(rotation=turn @ record.rotation, translation=turn @ record.translation)


@pytest.mark.full
def test_two_people_are_distinguished(data_dir: Path, records: tuple[CameraRecord, ...]) -> None:
    """The second person of the recording is an exact projection of confidence 1; the first one is real."""
    people = [read_openpose(data_dir / "pose2sim_two_people" / f"cam0{c}_json") for c in (1, 2, 3, 4)]
    cameras = cameras_of_records(records)
    for person, synthetic in ((1, True), (2, False)):
        chosen = associate_person(cameras, people, 60.0, person)
        seen = chosen >= 0
        assert seen.mean() > 0.98
        for c, found in enumerate(people):
            certain = (found.confidence[np.arange(len(chosen)), chosen[:, c]] > 0.999).any(-1)
            assert (certain[seen[:, c]] == synthetic).mean() > 0.98
    with pytest.raises(InputError, match="people are seen by two cameras"):
        associate_person(cameras, people, 60.0, 200)


@pytest.mark.full
def test_points_somewhere_else_in_the_picture_are_not_seen(records: tuple[CameraRecord, ...], folders: dict[str, Path]) -> None:
    """One point in fifty, at least a fifth of the picture's diagonal away; nothing else is taken away."""
    rng = np.random.default_rng(0)
    people = {name: read_openpose(folders[name]) for name in ("cam_03", "cam_04")}
    strewn, astray = {}, []
    for name, found in people.items():
        far = rng.random(found.points.shape[:-1]) < 0.02
        turn = rng.uniform(0, 2 * np.pi, far.shape)
        shift = 0.2 * np.hypot(1088, 1920) * np.stack([np.cos(turn), np.sin(turn)], -1)
        strewn[name] = found._replace(points=found.points + far[..., None] * shift)
        astray.append(far[:, 0])
    plain = scene_of_keypoints(KeypointSettings(people, records, rate=60, keep=("calibration",))).scene.data.points
    found = scene_of_keypoints(KeypointSettings(strewn, records, rate=60, keep=("calibration",)))
    numbers, names = markers_of_names(people["cam_03"].names), found.scene.body.tree.marker_names
    into = [index for index, name in enumerate(names) if name in numbers]
    of = [numbers[names[index]] for index in into]
    wrong = np.stack(astray, 1)[:, :, of]
    seen, before = (np.isfinite(points).all(-1)[:, :, into] for points in (found.scene.data.points, plain))
    assert wrong.sum() > 30 and not seen[wrong].any()
    assert (seen | ~before)[~wrong].mean() > 0.99
    assert any("points jump" in note for note in found.notes())


def test_a_camera_that_is_off_keeps_the_only_person(records: tuple[CameraRecord, ...], folders: dict[str, Path]) -> None:
    """Rays of a camera that is pitched by two degrees pass those of another by some 170 mm."""
    people = [read_openpose(folders[name]) for name in ("cam_03", "cam_04")]
    cameras = cameras_of_records([turned(records[2], (2.0, 0.0, 0.0)), records[3]])
    assert (associate_person(cameras, people, 60.0) >= 0).mean() > 0.98
    twice = people[1]._replace(**{name: np.repeat(getattr(people[1], name), 2, 1) for name in ("points", "confidence")})
    with pytest.raises(InputError, match="nobody is seen"):
        associate_person(cameras, [people[0], twice], 60.0)


@pytest.mark.full
def test_one_camera_follows_one_of_its_people(data_dir: Path, records: tuple[CameraRecord, ...]) -> None:
    found = read_openpose(data_dir / "pose2sim_balancing" / "pose" / "cam01_json")
    published = np.load(data_dir / "pose2sim_balancing" / "reference" / "balancing_keypoints.npz")["kp"][:, 0, :, :2]
    chosen = associate_person(cameras_of_records(records[:1]), [found], 60.0)[:, 0]
    off = np.linalg.norm(found.points[np.arange(100), chosen] - published, axis=-1)
    assert np.flatnonzero(chosen < 0).tolist() == [37]  # there the detector has the man in two halves
    assert np.nanmax(off[chosen >= 0]) < 0.01


@pytest.mark.full
def test_a_stature_that_one_camera_takes_for_granted_is_reported(
    records: tuple[CameraRecord, ...], folders: dict[str, Path]
) -> None:
    one = {"cam_01": folders["cam_01"]}
    told, given = (
        scene_of_keypoints(KeypointSettings(one, records, rate=60, stature=stature)).notes() for stature in (None, 1800.0)
    )
    assert "assumed to be 1.69 ± 0.09 m tall" in " ".join(told) and "tall" not in " ".join(given)
    assert "tall" not in " ".join(
        scene_of_keypoints(KeypointSettings(folders, records, rate=60, keep=("calibration",))).notes()
    )


@pytest.mark.full
def test_the_person_and_the_cameras_errors_are_found(
    data_dir: Path, records: tuple[CameraRecord, ...], folders: dict[str, Path]
) -> None:
    published = np.load(data_dir / "pose2sim_balancing" / "reference" / "balancing_keypoints.npz")
    kept = scene_of_keypoints(KeypointSettings(folders, records, rate=60, keep=("calibration",)))
    index = kept.scene.body.tree.marker_names.index("wrist_l")
    wrist = published["kp"][:, :, list(published["names"]).index("LWrist"), :2]
    assert np.nanmax(np.linalg.norm(kept.scene.data.points[:, :, index] - wrist, axis=-1)) < 0.01
    assert any("cam_01: points lie" in note for note in kept.notes())
    assert 300 < kept.scene.body.lengths["thigh"] < 500
    corrected = scene_of_keypoints(KeypointSettings(folders, records, rate=60))
    assert (corrected.errors.scale < 10).all()  # 20, 10, 26 and 11 px as calibrated
    assert (np.linalg.norm(corrected.errors.bias, axis=-1) < 1.5).all()
    assert (kept.errors.scale > corrected.errors.scale).all()
    assert any("cam_01: its calibration is off by" in note for note in corrected.notes())
    assert (corrected.agreement > 0.98).all()
    associated: Any = corrected.associated  # nobody's limbs are exchanged, and nobody else is taken for him
    assert associated.pairs == ("arms", "legs") and not (associated.swaps > 0.5).any()
    assert associated.swaps.mean() < 0.001 and np.nanmin(associated.identity) > 0.99
    assert np.array_equal(corrected.scene.data.points, kept.scene.data.points, equal_nan=True)


@pytest.mark.full
@pytest.mark.parametrize("camera", [0, *(pytest.param(other, marks=pytest.mark.slow) for other in (1, 2, 3))])
def test_a_turned_camera_is_the_first_one_named(
    records: tuple[CameraRecord, ...], folders: dict[str, Path], camera: int
) -> None:
    wrong = list(records)
    wrong[camera] = turned(wrong[camera], (0, 2, 0))
    found = scene_of_keypoints(KeypointSettings(folders, wrong, rate=60))
    assert found.refined is not None
    assert int(np.argmax(np.linalg.norm(found.refined.turn, axis=-1))) == camera
    assert [note for note in found.notes() if "its calibration is off by" in note][0].startswith(f"cam_0{camera + 1}:")
    assert (found.errors.scale < 11).all()


@pytest.mark.full
def test_exchanged_cameras_are_named(records: tuple[CameraRecord, ...], folders: dict[str, Path]) -> None:
    first, second, third, fourth = records
    wrong = (third._replace(name="cam_01"), second, first._replace(name="cam_03"), fourth)
    told = " ".join(scene_of_keypoints(KeypointSettings(folders, wrong, rate=60)).notes())
    assert "cam_01: its person agrees" in told
    assert "cam_03: its person agrees" in told
    assert "cam_02: its person agrees" not in told


@pytest.mark.slow
def test_errors_drawn_from_the_prior_lie_in_the_posterior(records: tuple[CameraRecord, ...], folders: dict[str, Path]) -> None:
    """The person's places projected by cameras with known errors, noise of 8 px that is new each second."""
    scene = scene_of_keypoints(KeypointSettings(folders, records, rate=60)).scene
    calibrated, shape = scene.cameras, scene.data.points.shape
    places = triangulate(calibrated, scene.data.points, np.ones(shape[:3]))
    scores, left, before = [], [], []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        turn, shift = PRIOR_ANGLE * rng.standard_normal((4, 3)), PRIOR_POSITION * rng.standard_normal((4, 3))
        rotation = Rotation.from_rotvec(turn).as_matrix() @ np.asarray(calibrated.rotation, np.float64)
        centre = jnp.asarray(np.asarray(calibrated.centre, np.float64) + shift, float)
        true = calibrated._replace(rotation=jnp.asarray(rotation, float), centre=centre)
        noise = np.repeat(8.0 * rng.standard_normal((2, *shape[1:])), [60, len(places) - 60], axis=0)
        points = np.moveaxis(np.asarray(project(true, jnp.asarray(places, float)), np.float64), 0, 1) + noise
        found: Any = bundle_adjust(calibrated, points, np.ones(shape[:3]), 8.0, 60.0)
        scores += [(found.turn - turn) / found.turn_deviation, (found.shift - shift) / found.shift_deviation]
        left.append(camera_errors(found.cameras, points, triangulate(found.cameras, points, np.ones(shape[:3]))).scale)
        before.append(camera_errors(calibrated, points, triangulate(calibrated, points, np.ones(shape[:3]))).scale)
    # 96 scores, dependent within a seed: of a variance within 4 standard errors of 24 independent ones'
    assert abs(np.mean(np.square(scores)) - 1) < 4 * np.sqrt(2 / 24)
    assert np.median(left) < 10 < 15 < np.median(before)


@pytest.mark.full
def test_a_person_who_leaves_and_frames_without_detections_are_reported(
    tmp_path: Path, data_dir: Path, records: tuple[CameraRecord, ...]
) -> None:
    """One camera finds nobody in two of three frames, and the person is gone after frame 69: all else is as it was."""
    folders = {}
    for c in (1, 2, 3, 4):
        folder = tmp_path / f"cam0{c}"
        folder.mkdir()
        folders[f"cam_0{c}"] = folder
        for frame in range(100):
            name = f"cam0{c}.{frame:04d}.json"
            gone = frame >= 70 or (c == 2 and frame % 3)
            text = (data_dir / "pose2sim_balancing" / "pose" / f"cam0{c}_json" / name).read_text()
            (folder / name).write_text('{"people": []}' if gone else text)
    found = scene_of_keypoints(KeypointSettings(folders, records, rate=60, keep=("calibration",)))
    assert any(note.startswith("cam_02: nobody was found in 76% of its 100 frames") for note in found.notes())
    left = "no camera sees the person in 30 of 100 frames, the longest gap from frame 70 to 99"
    assert any(note.startswith(left) for note in found.notes())
    seen = np.isfinite(found.scene.data.points).all(-1).any(-1)
    assert len(found.scene.frames) == 100 and seen[:70, [0, 2, 3]].mean() > 0.98 and not seen[70:].any()
    assert seen[:70:3, 1].mean() > 0.9 and (found.agreement > 0.9).all()


@pytest.mark.full
def test_what_does_not_fit_is_reported(records: tuple[CameraRecord, ...], folders: dict[str, Path]) -> None:
    with pytest.raises(InputError, match=r"no camera 'cam1' in the calibration \(expected cam_01, cam_02"):
        scene_of_keypoints(KeypointSettings({"cam1": folders["cam_01"]}, records))
    with pytest.raises(InputError, match="people are seen"):
        scene_of_keypoints(KeypointSettings(folders, records, rate=60, person=200))


def test_animals_point_to_a_skeleton_and_parts_of_a_person_do_not(folders: dict[str, Path]) -> None:
    person = read_openpose(folders["cam_01"])
    body = full_body().tree.marker_names
    check_markers(person, body)
    fly = person._replace(layout="", names=("nose", "head", "neck", "shoulder_left", "shoulder_right", "tail_base", "trunk"))
    with pytest.raises(InputError, match="files: 3 of the body's 17 markers .*tail_base.*tracked as points .*model='BUILDER'"):
        check_markers(fly, body)
    check_markers(fly, ("shoulder_l", "elbow_l", "wrist_l"))  # of an arm it is enough
    legs = person._replace(layout="", names=tuple(f"{joint}{side}" for side in "LR" for joint in ("Hip", "Knee", "Ankle")))
    check_markers(legs, body)
