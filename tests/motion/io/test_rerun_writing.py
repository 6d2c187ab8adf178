"""Recordings for rerun, read again by its own library."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from rooms import PRINCIPAL, room_result
from synthetic import synthetic_result

from poseppl.errors import InputError, PosepplError
from poseppl.motion.io.rerun_writing import write_rerun
from poseppl.runs.results import Names, build_result


def _read(path: Path) -> dict[str, list[dict[str, object]]]:
    """Rows of columns by entity."""
    from rerun.chunk import RrdReader

    found: dict[str, list[dict[str, object]]] = {}
    for chunk in RrdReader(path).stream():
        found.setdefault(chunk.entity_path.strip("/").replace("\\", ""), []).extend(chunk.to_record_batch().to_pylist())
    return found


def test_poses_cameras_and_points_are_there_again(tmp_path: Path) -> None:
    tree = room_result(6)
    times = (tree["posterior"]["frame"].values) / 30.0
    write_rerun(tmp_path / "walk.rrd", tree, times)
    assert [path.name for path in tmp_path.iterdir()] == ["walk.rrd"]
    found = _read(tmp_path / "walk.rrd")
    beside = {f"world/cameras/{name}" for name in ("left", "a camera with a long name")}
    images = {f"{name}/{kind}" for name in beside for kind in ("observed", "mean")}
    assert {"world/mean", "world/skeleton", "world/draws", "world/truth"} | beside | images <= set(found)
    rows = sorted(found["world/mean"], key=lambda row: row["frame"])
    assert [row["frame"] for row in rows] == list(range(10, 16))
    np.testing.assert_allclose([row["time"].total_seconds() for row in rows], times, atol=1e-6)
    np.testing.assert_allclose([row["Points3D:positions"] for row in rows], tree["summary/markers_mean"].values, rtol=1e-5)
    assert rows[0]["Points3D:labels"] == tree["posterior"]["marker"].values.tolist()
    seen = sorted(found["world/cameras/a camera with a long name/observed"], key=lambda row: row["frame"])
    assert [len(row["Points2D:positions"]) for row in seen] == [15, 15, 15, 15, 14, 15]
    lens = {key: value for row in found["world/cameras/left"] for key, value in row.items() if value is not None}
    np.testing.assert_allclose(lens["Pinhole:image_from_camera"][0][6:8], PRINCIPAL[0])


def test_images_that_are_upside_down_stand_apart(tmp_path: Path) -> None:
    write_rerun(tmp_path / "walk.rrd", synthetic_result(num_frames=2), np.arange(2) / 30)
    assert {"images/front/observed", "images/front/mean"} <= set(_read(tmp_path / "walk.rrd"))


def test_what_is_missing_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="no markers"):
        write_rerun(tmp_path / "a.rrd", build_result(state=np.zeros((1, 2, 3, 1)), names=Names(("level",))), np.zeros(3))
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(PosepplError, match=r"pip install 'poseppl\[rerun\]'"):
        write_rerun(tmp_path / "a.rrd", synthetic_result(num_frames=2), np.zeros(2))
    assert list(tmp_path.iterdir()) == []
