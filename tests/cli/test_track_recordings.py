"""Recordings of many origins, tracked and simulated by the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from poseppl.cli import main
from poseppl.runs.results import load_result, provenance

SMALL = ["--filter", "particle", "--set", "num_particles=100", "--max-draws", "10", "-q", "-o", "out.nc"]
SKELETON = "cmu_expmap/skeleton.json"
pytestmark = pytest.mark.usefixtures("here", "without_pictures")


@pytest.mark.full
@pytest.mark.parametrize(
    ("file", "skeleton", "limit"),
    [
        ("btk_c3d/PiG_Motion3_FF.c3d", None, 6.0),
        pytest.param("opensim_mocap/walking1.trc", None, 6.0, marks=pytest.mark.slow),
        ("opensim_mocap/motion_capture_walk.trc", None, 10.0),
        pytest.param("pose2sim_balancing/reference/Balancing_for_IK.trc", None, 25.0, marks=pytest.mark.slow),
        pytest.param("cmu_expmap/train_walking/walking_1.txt", SKELETON, 8.0, marks=pytest.mark.slow),
    ],
)
def test_recordings_are_tracked(data_dir: Path, file: str, skeleton: str | None, limit: float) -> None:
    options = [] if skeleton is None else ["--skeleton", str(data_dir / skeleton)]
    assert main(["track", str(data_dir / file), *options, "--frames", "20:80:20", *SMALL]) == 0
    tree = load_result("out.nc")
    assert 0 < provenance(tree)["residual_mm"] < limit
    assert np.isfinite(tree["truth/markers"].values).all(-1).sum() >= 3 * 7
    assert np.isfinite(tree["unconstrained_posterior/state"].values).all()


@pytest.mark.full
def test_names_and_lengths_come_from_tables(data_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (data_dir / "pybvh" / "cmu_12_01_walk.bvh").read_text().replace("Left", "Port").replace("Right", "Starboard")
    Path("ship.bvh").write_text(text)
    track = ["track", "ship.bvh", "--frames", "20:80:20", *SMALL]
    assert main(track) == 1
    message = capsys.readouterr().err
    assert "too few for the body" in message and "name them with --names TABLE.toml" in message and len(message) < 500
    parts = {"shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand", "hip": "UpLeg", "knee": "Leg", "ankle": "Foot"}
    sides = {"l": "Port", "r": "Starboard"}
    lines = [f'{marker}_{side} = "{word}{part}"' for marker, part in parts.items() for side, word in sides.items()]
    Path("names.toml").write_text("\n".join(lines))
    Path("lengths.toml").write_text("thigh = 345.0")
    assert main([*track, "--names", "names.toml", "--lengths", "lengths.toml"]) == 0
    tree = load_result("out.nc")
    assert provenance(tree)["residual_mm"] < 10 and provenance(tree)["lengths"]["thigh"] == 345.0
    for table, words in (
        ("knee_l = 3", "knee_l: not a name"),
        ('knee_l = "Leg"', "no 'Leg'"),
        ('knie = "PortLeg"', "no marker 'knie'"),
    ):
        Path("names.toml").write_text(table)
        assert main([*track, "--names", "names.toml"]) == 1
        assert words in capsys.readouterr().err
    Path("lengths.toml").write_text("tail = 345.0")
    Path("names.toml").write_text("\n".join(lines))
    assert main([*track, "--names", "names.toml", "--lengths", "lengths.toml"]) == 1
    assert "lengths.toml, --lengths: unknown name 'tail'" in capsys.readouterr().err


@pytest.mark.slow
def test_stature_of_points(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--frames", "0:1", "-q"]) == 0
    track = ["track", "--observations", "poseppl-walk.csv", "--camera", "poseppl-walk.toml", *SMALL]
    lengths = []
    for option in ([], ["--stature", "1400"], ["--stature", "1400", "--lengths", "lengths.toml"]):
        Path("lengths.toml").write_text("thigh = 400")
        assert main([*track, *option]) == 0
        lengths.append(provenance(load_result("out.nc"))["lengths"])
    assert lengths[1] == pytest.approx({name: 0.8 * value for name, value in lengths[0].items()})
    assert lengths[2] == {**lengths[1], "thigh": 400.0}
    assert main(["track", "--stature", "1400"]) == 2
    assert "--stature is an option of poseppl track observations" in capsys.readouterr().err
    assert main([*track, "--stature", "3"]) == 1
    assert "--stature: 3 (expected 500 to 2500 mm)" in capsys.readouterr().err


@pytest.mark.full
def test_points_of_no_body_are_reported_briefly(capsys: pytest.CaptureFixture[str]) -> None:
    names = "\t\t\t".join(f"point{number}" for number in range(200))
    head = "PathFileType\t4\nDataRate\tUnits\n50\tmm\n" + f"Frame#\tTime\t{names}\n\tX1\n"
    Path("many.trc").write_text(head + "1\t0.0" + "\t1" * 600 + "\n")
    assert main(["track", "many.trc", *SMALL]) == 1
    message = capsys.readouterr().err
    assert "none of its" in message and "(200 in all)" in message and len(message) < 500
