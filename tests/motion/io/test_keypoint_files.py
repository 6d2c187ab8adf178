"""JSON and CSV of AlphaPose, MMPose and MediaPipe, and what a file is, found from its content."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io.keypoint_layouts import LAYOUTS, markers_of_names, plain_name
from poseppl.motion.io.keypoints import detector_of, read_keypoints
from poseppl.motion.io.mediapipe import read_mediapipe

TABLE = np.round(np.random.default_rng(1).uniform(1, 900, (3, 2, 17, 3)), 2)
"""Three frames of two people."""
TABLE[..., 2] /= 1000


def alphapose(table: np.ndarray = TABLE) -> list[dict[str, Any]]:
    return [
        {"image_id": f"{frame + 4}.jpg", "category_id": 1, "keypoints": person.ravel().tolist(), "score": 2.0}
        for frame, people in enumerate(table)
        for person in people
    ]


def instances(people: np.ndarray) -> list[dict[str, Any]]:
    return [{"keypoints": person[:, :2].tolist(), "keypoint_scores": person[:, 2].tolist()} for person in people]


def mmpose(table: np.ndarray = TABLE) -> dict[str, Any]:
    frames = [{"frame_id": frame + 1, "instances": instances(people)} for frame, people in enumerate(table)]
    return {"meta_info": {"keypoint_id2name": {str(k): f"p{k}" for k in range(table.shape[2])}}, "instance_info": frames}


def landmarks(frame: int) -> list[dict[str, float]]:
    return [{"x": 0.01 * k, "y": 0.02 * frame + 0.1, "z": -0.3, "visibility": 0.9} for k in range(1, 34)]


def write(path: Path, document: Any) -> Path:
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


def test_alphapose(tmp_path: Path) -> None:
    path = write(tmp_path / "alphapose-results.json", alphapose())
    found = read_keypoints(path)
    assert detector_of(path) == "alphapose" and found.layout == "coco17" and found.frames.tolist() == [4, 5, 6]
    np.testing.assert_array_equal(found.points, TABLE[..., :2])
    np.testing.assert_array_equal(found.confidence, TABLE[..., 2])


@pytest.mark.parametrize("form", ["whole", "list", "bare", "folder"])
def test_mmpose(tmp_path: Path, form: str) -> None:
    document: Any = mmpose()
    if form == "list":
        document = document["instance_info"]
    if form == "bare":
        document = [frame["instances"] for frame in document["instance_info"]]
    if form == "folder":
        for frame in document["instance_info"]:
            write(tmp_path / f"img_{frame['frame_id']:04d}.json", {"meta_info": {}, "instance_info": frame["instances"]})
    path = tmp_path if form == "folder" else write(tmp_path / "predictions.json", document)
    found = read_keypoints(path)
    assert detector_of(path) == "mmpose" and found.layout == "coco17"
    assert found.frames.tolist() == ([0, 1, 2] if form == "bare" else [1, 2, 3])
    np.testing.assert_array_equal(found.points, TABLE[..., :2])


def test_names_of_a_file_serve_where_no_layout_does(tmp_path: Path) -> None:
    found = read_keypoints(write(tmp_path / "p.json", mmpose(TABLE[:, :, :5])))
    assert found.layout == "" and found.names == ("p0", "p1", "p2", "p3", "p4")


HUMAN36M = ["root", *(f"{side}_{joint}" for side in ("right", "left") for joint in ("hip", "knee", "foot"))]
HUMAN36M += ["spine", "thorax", "neck_base", "head"]
HUMAN36M += [f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist")]


@pytest.mark.parametrize(
    ("names", "layout"),
    [
        (HUMAN36M, ""),
        (["nose", "neck", "right_shoulder", *(f"p{number}" for number in range(130))], ""),  # OpenPose's order
        ([f"left_{name[:-2]}" if name.endswith("_l") else name for name in LAYOUTS["coco17"]], "coco17"),
        ([*LAYOUTS["coco17"], *(f"face-{number}" for number in range(116))], "coco17"),
        ([*LAYOUTS["coco23"], *(f"face-{number}" for number in range(110))], "coco23"),
        ([f"p{number}" for number in range(17)], "coco17"),
    ],
)
def test_names_of_other_joints_are_no_layout_of_as_many_points(tmp_path: Path, names: list[str], layout: str) -> None:
    document = mmpose(np.random.default_rng(0).uniform(1, 2, (2, 1, len(names), 3)))
    document["meta_info"] = {"keypoint_id2name": {str(number): name for number, name in enumerate(names)}}
    found = read_keypoints(write(tmp_path / "p.json", document))
    assert found.layout == layout and found.names == (LAYOUTS[layout] if layout else tuple(names))


def test_times_that_tell_nothing_or_go_back(tmp_path: Path) -> None:
    def timed(*times: float | None) -> Path:
        return write(tmp_path / "a.json", [{"time": time, "landmarks": landmarks(f)} for f, time in enumerate(times)])

    assert read_keypoints(timed(None, None), size=(1000, 500)).times is None
    found = read_keypoints(timed(0.0, None, 0.5), size=(1000, 500)).times
    assert found is not None
    np.testing.assert_array_equal(found, [0.0, np.nan, 0.5])
    with pytest.raises(InputError, match="the time of frame 2 is before that of the frame before"):
        read_keypoints(timed(0.5, None, 0.0), size=(1000, 500))


def test_a_depth_is_no_visibility(tmp_path: Path) -> None:
    places = [[mark["x"], mark["y"], -0.2] for mark in landmarks(0)]
    with pytest.raises(InputError, match=r"landmarks\[0\]: a visibility below 0"):
        read_keypoints(write(tmp_path / "a.json", [places]), size=(1000, 500))


@pytest.mark.parametrize(("count", "layout"), [(133, "coco23"), (136, "halpe26")])
def test_whole_bodies_are_cut_to_the_body(tmp_path: Path, count: int, layout: str) -> None:
    table = np.random.default_rng(0).uniform(1, 2, (2, 1, count, 3))
    found = read_keypoints(write(tmp_path / "p.json", alphapose(table)))
    kept = len(LAYOUTS[layout])
    assert found.layout == layout and found.names == LAYOUTS[layout]
    np.testing.assert_array_equal(found.points, table[:, :, :kept, :2])


def wide(visible: str = "0.9") -> str:
    names = LAYOUTS["mediapipe33"]
    header = ["frame", "timestamp", *(f"{name}_{kind}" for name in names for kind in ("x", "y", "z", "visibility"))]
    rows = [
        [str(frame), str(frame / 50), *(w for mark in landmarks(frame) for w in (str(mark["x"]), str(mark["y"]), "0", visible))]
        for frame in (0, 1)
    ]
    return "\n".join(",".join(row) for row in [header, *rows]) + "\n"


def long() -> str:
    names = [*LAYOUTS["mediapipe33"][:-1], "32"]
    rows = [f"{f},{f / 50},{n},{m['x']},{m['y']},0.9" for f in (0, 1) for n, m in zip(names, landmarks(f), strict=True)]
    return "\n".join(["frame,timestamp,landmark,x,y,visibility", *rows]) + "\n"


@pytest.mark.parametrize(
    ("name", "document"),
    [
        ("a.json", [{"frame": f, "timestamp_ms": 20 * f, "landmarks": landmarks(f)} for f in (0, 1)]),
        ("b.json", {"frames": [{"frame": f, "time": f / 50, "pose_landmarks": [landmarks(f)]} for f in (0, 1)]}),
        ("c.json", [{"timestamp": f / 50, "landmarks": [[m["x"], m["y"], 0.0, 0.9] for m in landmarks(f)]} for f in (0, 1)]),
        ("d.csv", wide()),
        ("e.csv", long()),
    ],
)
def test_mediapipe(tmp_path: Path, name: str, document: Any) -> None:
    path = write(tmp_path / name, document)
    assert detector_of(path) == "mediapipe"
    found = read_keypoints(path, size=(1000, 500))
    assert found.layout == "mediapipe33" and found.times is not None
    np.testing.assert_allclose(found.times, [0, 0.02])
    np.testing.assert_allclose(found.points[1, 0, 11], [120.0, 60.0])
    markers = markers_of_names(LAYOUTS["mediapipe33"])
    assert markers["shoulder_l"] == 11 and markers["ankle_r"] == 28
    with pytest.raises(InputError, match="shares of the picture's size, which is unknown"):
        read_mediapipe(path)


def test_several_people_and_nobody(tmp_path: Path) -> None:
    poses: list[Any] = [[landmarks(0), landmarks(1)], [], None, [landmarks(2)]]
    document = [{"landmarks": found} for found in poses]
    found = read_mediapipe(write(tmp_path / "a.json", document), (1000, 500))
    assert np.isfinite(found.points).all((2, 3)).tolist() == [[True, True], [False, False], [False, False], [True, False]]


def test_names_tell_markers() -> None:
    names = ("LShoulder", "right_knee", "Hip L", "tail", "MidHip", "l_wrist")
    assert markers_of_names(names) == {"shoulder_l": 0, "knee_r": 1, "hip_l": 2, "pelvis": 4, "wrist_l": 5}
    for names in LAYOUTS.values():
        assert tuple(map(plain_name, names)) == names
    assert markers_of_names(("left_foot_index", "RBigToe", "RHeel", "left_ear")) == {
        "big_toe_l": 0,
        "big_toe_r": 1,
        "heel_r": 2,
        "ear_l": 3,
    }


@pytest.mark.parametrize(
    ("name", "document", "words"),
    [
        ("a.json", {"a": 1}, "no keypoints of a detector that is known .*detector says which"),
        ("a.txt", "hello", "no keypoints of a detector that is known"),
        ("a.csv", "a,b\n1,2\n", "no keypoints of a detector that is known"),
        ("a.json", [{"image_id": "x.jpg", "keypoints": [1, 2, 3]}], r"\[0\]\.image_id: 'x\.jpg' has no frame number"),
        ("a.json", [{"image_id": "1.jpg", "keypoints": [1, 2]}], r"\[0\]\.keypoints: 2 numbers .expected 3 numbers a point"),
        ("a.json", [{"image_id": "1.jpg", "keypoints": [1, 2, 3] * 5}], "people with 5 points"),
        ("a.json", [{"image_id": "1.jpg"}], "not a list of numbers"),
        ("a.json", [{"instances": [{"keypoints": [[1, 2]], "keypoint_scores": []}]}], "1 keypoints and 0 scores"),
        ("a.json", [{"instances": [{}]}], "no person"),
        ("a.json", [{"frame_id": 1, "instances": []}, {"frame_id": 1, "instances": []}], "frame 1 comes twice"),
        ("a.json", [{"frame_id": 1, "instances": []}], "nobody was found in any of 1 frames"),
        ("a.json", [{"landmarks": [{"x": 1, "y": 2}]}], "1 landmarks .expected 33"),
        ("a.json", [{"landmarks": [{"x": 1}] * 33}], r"landmarks\[0\]: no landmark"),
        ("a.csv", "frame,x,y\n0,1,2\n", "no columns nose_x and nose_y"),
        ("a.csv", "frame,landmark,x,y\n0,tail,1,2\n", "line 2, landmark: 'tail' .expected 0 to 32"),
        ("a.csv", "frame,landmark,x,y\n0,nose,1,2\n0,0,1,2\n", "line 3: landmark nose of frame 0 comes twice"),
        ("a.csv", "frame,landmark,x,y\n0,nose,1\n", "line 2: 3 values"),
        ("a.json", [{"image_id": "1.jpg", "keypoints": [1e10, 2, 3] * 17}], "person 1, 0, x: the number 1e.10 is too large"),
    ],
)
def test_a_wrong_file_is_reported(tmp_path: Path, name: str, document: Any, words: str) -> None:
    with pytest.raises(InputError, match=rf"a\.(json|csv|txt).*{words}"):
        read_keypoints(write(tmp_path / name, document), size=(1000, 500))


def test_detectors_and_layouts_that_do_not_fit(tmp_path: Path, data_dir: Path) -> None:
    with pytest.raises(InputError, match="detector: 'mine'"):
        read_keypoints(tmp_path, "mine")
    (file,) = (data_dir / "fly_legs").glob("*Cam-A*rng=0.csv")
    assert detector_of(file) == "deeplabcut" and read_keypoints(file).names[0] == "L1A"
    with pytest.raises(InputError, match="people with 12 points .expected 17, as coco17 has"):
        read_keypoints(file, layout="coco17")
    board = data_dir / "charuco_board" / "xy_CHARUCO.csv"
    assert detector_of(board) == "caliscope" and read_keypoints(board, camera="2").points.shape[2] == 9 + 3
    with pytest.raises(InputError, match="no points of the camera 'left' .expected 0, 1, 2, 3"):
        read_keypoints(board, camera="left")
    assert detector_of(data_dir / "pose2sim_balancing" / "pose" / "cam01_json") == "openpose"


SIZE = (1600, 900)


@pytest.mark.parametrize(("width", "more"), [(3, ""), (3, " 0.91"), (3, " 0.91 7"), (2, ""), (2, " 0.91"), (2, " 0.91 7")])
def test_ultralytics(tmp_path: Path, width: int, more: str) -> None:
    """With or without the confidences of points, that of the box, and the number of the track."""
    shares = TABLE / (*SIZE, 1)
    for frame, people in enumerate(shares):
        lines = [
            "0 0.5 0.5 0.2 0.6 " + " ".join(f"{value:.6f}" for value in person[:, :width].ravel()) + more for person in people
        ]
        write(tmp_path / f"walk_{frame + 1}.txt", "\n".join(lines) + "\n")
    write(tmp_path / "walk_4.txt", "")
    found = read_keypoints(tmp_path, size=SIZE)
    assert detector_of(tmp_path) == "ultralytics" and found.layout == "coco17" and found.frames.tolist() == [1, 2, 3, 4]
    np.testing.assert_allclose(found.points[:3], TABLE[..., :2], atol=1e-3)
    np.testing.assert_allclose(found.confidence[:3], TABLE[..., 2] if width == 3 else 1.0, atol=1e-6)
    assert np.isnan(found.points[3]).all() and found.notes == ("1 of 4 files are empty, and nobody is seen in their frames: 4",)
    with pytest.raises(InputError, match="shares of a picture whose size is not known"):
        read_keypoints(tmp_path)
    write(tmp_path / "walk_5.txt", "0 0.5 0.5 0.2 0.6\n")
    with pytest.raises(InputError, match="walk_5.txt, line 1: 5 numbers .*Ultralytics"):
        read_keypoints(tmp_path, size=SIZE)


def test_vitpose(tmp_path: Path) -> None:
    """Rows before columns; a frame may hold nobody, tracks come and go."""
    frames: list[dict[str, Any]] = [
        {str(3 * p): person[:, [1, 0, 2]].tolist() for p, person in enumerate(people)} for people in TABLE
    ]
    document = {
        "keypoints": [frames[0], {}, *frames[1:]],
        "skeleton": {str(k): name for k, name in enumerate(LAYOUTS["coco17"])},
    }
    path = write(tmp_path / "walk.json", document)
    found = read_keypoints(path)
    assert detector_of(path) == "vitpose" and found.layout == "coco17" and len(found.frames) == 4
    np.testing.assert_array_equal(found.points[[0, 2, 3]], TABLE[..., :2])
    assert np.isnan(found.points[1]).all()
    assert read_keypoints(write(path, {**document, "keypoints": frames})).points.shape == (3, 2, 17, 2)
    with pytest.raises(InputError, match=r"keypoints\[0\]: no people by the number of their track"):
        read_keypoints(write(path, {**document, "keypoints": [[1, 2]]}))


def test_freemocap(tmp_path: Path) -> None:
    values = np.random.default_rng(2).uniform(1, 900, (2, 4, 553, 2))
    values[1, 2] = np.nan
    values[1, 3] = 0.0
    path = tmp_path / "mediapipe2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy"
    np.save(path, values)
    found = read_keypoints(path, camera="b", cameras=("a", "b"))
    assert detector_of(path) == "freemocap" and found.layout == "mediapipe33"
    np.testing.assert_array_equal(found.points[:2, 0], values[1, :2, :33])
    assert np.isnan(found.points[2:]).all() and found.confidence[:2].min() == 1.0
    with pytest.raises(InputError, match="the array has 2 cameras, the calibration 3: a, b, c"):
        read_keypoints(path, camera="b", cameras=("a", "b", "c"))
    np.save(path, values[0])
    with pytest.raises(InputError, match=r"an array of shape \(4, 553, 2\)"):
        read_keypoints(path, camera="b", cameras=("a", "b"))
    np.save(path, np.array([{"a": 1}]))
    with pytest.raises(InputError, match="an array of object"):
        read_keypoints(path, camera="b", cameras=("a", "b"))
    path.write_bytes(path.read_bytes()[:20])
    with pytest.raises(InputError, match="no NumPy array"):
        read_keypoints(path, camera="b", cameras=("a", "b"))


@pytest.mark.parametrize("suffix", [".json", ".txt"])
def test_hidden_files_are_none_and_empty_ones_are_noted(tmp_path: Path, suffix: str) -> None:
    person = {"people": [{"pose_keypoints_2d": TABLE[0, 0].ravel().tolist()}]}
    line = "0 0.5 0.5 0.2 0.6 " + " ".join(f"{value:.6f}" for value in (TABLE[0, 0] / (*SIZE, 1)).ravel())
    for frame in (1, 3):
        write(tmp_path / f"cam_{frame}_keypoints{suffix}", person if suffix == ".json" else line)
        write(tmp_path / f"._cam_{frame}_keypoints{suffix}", "\x00\x05\x16\x07 a resource fork")
    write(tmp_path / f"cam_2_keypoints{suffix}", "")
    found = read_keypoints(tmp_path, size=SIZE)
    assert found.frames.tolist() == [1, 2, 3] and np.isnan(found.points[1]).all() and np.isfinite(found.points[[0, 2]]).all()
    assert found.notes == ("1 of 3 files are empty, and nobody is seen in their frames: 2",)
    for frame in (1, 3):
        write(tmp_path / f"cam_{frame}_keypoints{suffix}", "")
    with pytest.raises(InputError, match=f"all 3 {suffix} files are empty"):
        read_keypoints(tmp_path, size=SIZE)
