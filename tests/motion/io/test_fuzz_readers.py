"""Damaged files: every reader answers with a value or with one clear error, in bounded time."""

from __future__ import annotations

import json
from datetime import timedelta

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from recording_samples import (
    AMC,
    ASF,
    BVH,
    CALISCOPE,
    CHARACTER,
    CLIP,
    CSV,
    DEEPLABCUT,
    EXPONENTIAL_MAPS,
    EXPONENTIAL_SKELETON,
    MEDIAPIPE,
    MOT,
    TOML,
    TRC,
    YAML,
    c3d_bytes,
)
from waiting import PATIENCE

from poseppl.errors import PosepplError
from poseppl.motion.io.bvh import read_bvh
from poseppl.motion.io.c3d import read_c3d
from poseppl.motion.io.c3d_layout import read_layout
from poseppl.motion.io.cameras import read_cameras
from poseppl.motion.io.deeplabcut import read_deeplabcut_csv
from poseppl.motion.io.detector_tables import read_caliscope_points
from poseppl.motion.io.keypoints import read_keypoints
from poseppl.motion.io.observations import read_observations
from poseppl.motion.io.opensim_files import read_mot
from poseppl.motion.io.recording import read_motion

C3D = c3d_bytes(np.random.default_rng(0).normal(0, 300, (3, 4, 3)), ["LASI", "RASI", "*1", "LHipAngles"])
TOKENS = [
    "nan",
    "inf",
    "-1",
    "0",
    "1e308",
    "1e-308",
    "99999999999999999999",
    "9" * 5000,
    "{",
    "}",
    "(",
    ":",
    "[",
    "]]",
    '"',
    "",
]
TOKENS += ["\n", "#", "\x0c", "\u0663", "\ud7ff", "\x85", "begin", "end", "root", "JOINT", "End Site", "MOTION", "=", ",", "\0"]


BOUND = timedelta(seconds=PATIENCE)
"""For one example: no reader hangs."""


def fuzz(examples):
    def decorate(test):
        checks = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
        bounds = settings(max_examples=examples, derandomize=True, deadline=BOUND, database=None, suppress_health_check=checks)
        return bounds(test)

    return decorate


@st.composite
def damaged(draw, text):
    """The text with some of its tokens or lines removed, doubled, swapped or replaced, or cut off."""
    for _ in range(draw(st.integers(1, 3))):
        separator = draw(st.sampled_from([*(mark for mark in (" ", "\n", ",", "\t") if mark in text), ""]))
        parts = list(text) if separator == "" else text.split(separator)
        if not parts:
            break
        i, j = (draw(st.integers(0, len(parts) - 1)) for _ in range(2))
        match draw(st.sampled_from(["remove", "double", "swap", "replace", "cut"])):
            case "remove":
                del parts[i]
            case "double":
                parts.insert(j, parts[i])
            case "swap":
                parts[i], parts[j] = parts[j], parts[i]
            case "replace":
                parts[i] = draw(st.sampled_from(TOKENS))
            case "cut":
                del parts[i:]
        text = separator.join(parts)
    return text


@st.composite
def damaged_bytes(draw, data):
    changed = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(changed) - 1) if draw(st.booleans()) else st.integers(0, min(900, len(changed) - 1)))
        changed[at] = draw(st.sampled_from([0, 1, 2, 4, 127, 128, 255]) | st.integers(0, 255))
    return bytes(changed[: draw(st.sampled_from([len(changed), len(changed), draw(st.integers(1, len(changed)))]))])


def accept(read, *arguments, **options):
    try:
        return read(*arguments, **options)
    except PosepplError as error:
        assert 0 < len(str(error)) < 1000
        return None


@pytest.fixture
def write(tmp_path):
    def put(name, content):
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))
        return tmp_path / name

    return put


@pytest.mark.full
@fuzz(150)
@given(asf=damaged(ASF))
def test_asf(write, asf):
    motion = accept(read_motion, write("leg.amc", AMC), write("leg.asf", asf))
    assert motion is None or np.isfinite(motion.positions).all()


@pytest.mark.full
@fuzz(150)
@given(amc=damaged(AMC))
def test_amc(write, amc):
    motion = accept(read_motion, write("leg.amc", amc), write("leg.asf", ASF))
    assert motion is None or np.isfinite(motion.positions).all()


@pytest.mark.full
@fuzz(150)
@given(mot=damaged(MOT))
def test_mot(write, mot):
    found = accept(read_mot, write("walk.mot", mot))
    assert found is None or all(np.isfinite(values).all() for values in found.columns.values())


@pytest.mark.full
@fuzz(60)
@given(clip=damaged(CLIP), character=damaged(CHARACTER))
def test_deepmimic(write, clip, character):
    accept(read_motion, write("clip.txt", clip), write("character.txt", CHARACTER))
    accept(read_motion, write("clip.txt", CLIP), write("character.txt", character))


@pytest.mark.full
@fuzz(150)
@given(bvh=damaged(BVH))
def test_bvh(write, bvh):
    motion = accept(read_bvh, write("leg.bvh", bvh))
    assert motion is None or np.isfinite(motion.positions).all()


@pytest.mark.full
@fuzz(150)
@given(trc=damaged(TRC), commas=st.booleans(), up=st.sampled_from([None, "z"]))
def test_trc(write, trc, commas, up):
    motion = accept(read_motion, write("walk.trc", trc.replace("\t", ",") if commas else trc), up=up)
    if motion is not None:
        assert not np.isinf(motion.positions).any() and motion.positions.shape[1] == len(motion.names) > 0
        assert np.isfinite(motion.positions).all(-1).any(0).all() and 0 < motion.rate < np.inf


@pytest.mark.full
@fuzz(150)
@given(maps=damaged(EXPONENTIAL_MAPS))
def test_exponential_maps(write, maps):
    motion = accept(read_motion, write("walk.txt", maps), write("skeleton.json", EXPONENTIAL_SKELETON))
    assert motion is None or np.isfinite(motion.positions).all()


@pytest.mark.full
@fuzz(150)
@given(skeleton=damaged(EXPONENTIAL_SKELETON))
def test_skeleton_of_exponential_maps(write, skeleton):
    motion = accept(read_motion, write("walk.txt", EXPONENTIAL_MAPS), write("skeleton.json", skeleton))
    assert motion is None or (np.isfinite(motion.positions).all() and motion.positions.shape[1] == len(motion.parents))


@pytest.mark.full
@fuzz(150)
@given(table=damaged(CSV))
def test_csv(write, table):
    observations = accept(read_observations, write("points.csv", table), ("hip", "knee"), ("left", "right"))
    assert observations is None or not np.isinf(observations.points).any()


@pytest.mark.full
@fuzz(150)
@given(table=damaged(DEEPLABCUT), several=st.booleans())
def test_deeplabcut(write, table, several):
    owners = "individuals" + ",mouse" * 6 + "\n"
    found = accept(read_deeplabcut_csv, write("dlc.csv", owners + table if several else table))
    if found is not None:
        assert (found.confidence[~np.isfinite(found.points).all(-1)] == 0).all()
        assert not np.isinf(found.points).any() and np.isfinite(found.confidence).all()


@pytest.mark.full
@fuzz(150)
@given(table=damaged(CALISCOPE))
def test_caliscope_points(write, table):
    for found in (accept(read_caliscope_points, write("xy.csv", table)) or {}).values():
        assert not np.isinf(found.points).any() and np.isfinite(found.confidence).all()


JSON = {
    "alphapose": [{"image_id": f"{t}.jpg", "keypoints": [1.5, 2.5, 0.9] * 17} for t in range(2)],
    "mmpose": {
        "meta_info": {},
        "instance_info": [{"frame_id": 1, "instances": [{"keypoints": [[1, 2]] * 17, "keypoint_scores": [0.5] * 17}]}],
    },
    "mediapipe": [{"frame": 0, "timestamp_ms": 20, "landmarks": [{"x": 0.5, "y": 0.25, "visibility": 0.75}] * 33}],
}


@pytest.mark.full
@fuzz(150)
@given(kind=st.sampled_from(sorted(JSON)), data=st.data(), told=st.booleans())
def test_json_of_detectors(write, kind, data, told):
    text = data.draw(damaged(json.dumps(JSON[kind])))
    found = accept(read_keypoints, write("points.json", text), kind if told else None, size=(640, 480))
    if found is not None:
        assert not np.isinf(found.points).any() and np.isfinite(found.confidence).all()


@pytest.mark.full
@fuzz(150)
@given(table=damaged(MEDIAPIPE))
def test_mediapipe_table(write, table):
    found = accept(read_keypoints, write("points.csv", table), "mediapipe", size=(640, 480))
    assert found is None or not np.isinf(found.points).any()


@pytest.mark.full
@fuzz(150)
@given(rig=damaged(YAML), suffix=st.sampled_from([".yml", ".qca.txt", ".pickle"]))
def test_other_calibrations(write, rig, suffix):
    for camera in accept(read_cameras, write("rig" + suffix, rig)) or ():
        assert all(np.isfinite(getattr(camera, field)).all() for field in ("matrix", "distortion", "rotation", "translation"))


@pytest.mark.full
@fuzz(150)
@given(rig=damaged(TOML))
def test_toml(write, rig):
    for camera in accept(read_cameras, write("rig.toml", rig)) or ():
        assert all(np.isfinite(getattr(camera, field)).all() for field in ("matrix", "distortion", "rotation", "translation"))


@pytest.mark.full
@fuzz(300)
@given(data=damaged_bytes(C3D))
def test_c3d_layout(write, data):
    accept(read_layout, write("small.c3d", data))


@pytest.mark.full
@fuzz(12)
@given(data=damaged_bytes(C3D))
def test_c3d(write, data):
    motion = accept(read_c3d, write("small.c3d", data))
    assert motion is None or not np.isinf(motion.positions).any()


@pytest.mark.full
@fuzz(60)
@given(
    data=st.binary(min_size=1, max_size=200),
    suffix=st.sampled_from(["leg.bvh", "rig.toml", "points.csv", "leg.asf", "x.c3d", "walk.trc", "walk.txt", "skeleton.json"]),
)
def test_noise(write, data, suffix):
    path = write(suffix, data)
    if suffix == "rig.toml":
        accept(read_cameras, path)
    elif suffix == "points.csv":
        accept(read_observations, path, ("hip",))
    elif suffix == "leg.asf":
        accept(read_motion, write("leg.amc", AMC), path)
    elif suffix == "walk.txt":
        accept(read_motion, path, write("skeleton.json", EXPONENTIAL_SKELETON))
    elif suffix == "skeleton.json":
        accept(read_motion, write("walk.txt", EXPONENTIAL_MAPS), path)
    else:
        accept(read_motion, path)


@pytest.mark.full
@pytest.mark.parametrize("depth", [200, 100_000])
def test_deep_nesting(write, depth):
    assert accept(read_cameras, write("rig.toml", "x = " + "[" * depth)) is None
    joint = "JOINT J%d\n{\nOFFSET 0 1 0\nCHANNELS 3 Xrotation Yrotation Zrotation\n"
    nested = "".join(joint % i for i in range(depth)).replace("JOINT J0\n", "ROOT J0\n", 1)
    accept(
        read_bvh,
        write("leg.bvh", "HIERARCHY\n" + nested + "}\n" * depth + "MOTION\nFrames: 1\nFrame Time: 1\n" + "0 " * 3 * depth),
    )
