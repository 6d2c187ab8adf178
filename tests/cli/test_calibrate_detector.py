"""`poseppl calibrate-detector`, and what it gives `poseppl track keypoints --noise`, on a real recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from balancing_options import words

from poseppl.cli import main
from poseppl.motion.keypoints.detector_files import read_detector_errors
from poseppl.runs.results import load_result, provenance

pytestmark = pytest.mark.usefixtures("here", "without_pictures")


@pytest.mark.slow
def test_errors_are_found_and_taken(data_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(["calibrate-detector", "openpose", *words(data_dir, 1, 2, 3, 4, source="--keypoints"), "--frames", "0:100:10"])
        == 0
    )
    printed = capsys.readouterr().out
    assert "other half's errors: coverage of 90 % intervals" in printed and "openpose.json" in printed
    errors = read_detector_errors("openpose.json")
    assert "pose/cam01_json" in errors.source and "body25b" in errors.source
    assert errors.slope < -0.3 and 0.5 < errors.confidence < 0.8
    assert all(3 < np.exp(scale) < 60 for scale in errors.log_scale.values())
    assert set(errors.counts) == set(errors.log_scale) and max(errors.counts.values()) <= 40
    small = ["--frames", "0:12:3", "--filter", "kalman", "--max-draws", "50", "--smooth", "none", "--set", "export=false"]
    for name, more in (("own", ["--noise", "openpose.json"]), ("root", [])):
        assert main(["track", *words(data_dir, 1, 4), *small, *more, "-o", f"{name}.nc"]) == 0
    assert f"the detector's errors are those of {errors.source}" in capsys.readouterr().err
    own, root = (np.asarray(load_result(f"{name}.nc")["summary/points_mean"]) for name in ("own", "root"))
    assert np.abs(own - root).max() > 0.1
    assert provenance(load_result("own.nc"))["detector errors"] == errors.source


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["calibrate-detector", "a", "--calibration", "c.toml"], "CAMERA=FILE..."),
        (["calibrate-detector", "a", "--keypoints", "x=y"], "--calibration"),
        (["track", "--layout", "coco17"], "--layout is an option of poseppl track keypoints and live"),
    ],
)
def test_usage(capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str) -> None:
    assert main(arguments) == 2
    assert expected in capsys.readouterr().err


@pytest.mark.full
def test_two_cameras_are_too_few(data_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate-detector", "a", *words(data_dir, 1, 4, source=""), "--frames", "0:20:2"]) == 1
    assert "three cameras see 0 points" in capsys.readouterr().err
    assert not Path("a.json").exists()


def test_a_noise_is_a_number_or_a_file(data_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for given, printed in (("0", "--noise: 0"), ("a.json", "a.json: no such file")):
        assert main(["track", *words(data_dir, 1, 4), "--noise", given]) == 1
        assert printed in capsys.readouterr().err
