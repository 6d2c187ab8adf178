"""`poseppl track points`: a fly's legs, of which a few frames are smoothed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseppl.cli import main
from poseppl.errors import InputError
from poseppl.motion.io.trc import read_trc
from poseppl.motion.points.named_points import PointRecording
from poseppl.runs.results import load_result, provenance

pytestmark = pytest.mark.usefixtures("without_pictures")

SKELETON = 'points = ["L1A", "L1B"]\n[[links]]\nbetween = ["L1A", "L1B"]\n[[pairs]]\nleft = ["L1A"]\nright = ["L1B"]\n'


@pytest.fixture(autouse=True)
def _files(here: None) -> None:
    Path("legs.toml").write_text(SKELETON, encoding="utf-8")


def words(data_dir: Path, *more: str) -> list[str]:
    folder = data_dir / "fly_legs"
    files = [f"Cam-{letter}={next(folder.glob(f'*Cam-{letter}*rng=0.csv'))}" for letter in "AB"]
    return ["track", "points", *files, "--calibration", str(folder / "calibration.toml"), "--rate", "100", *more]


@pytest.mark.slow
def test_linked_points_are_smoothed(data_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words(data_dir, "--skeleton", "legs.toml", "--frames", "0:12", "--max-draws", "30", "-o", "out.nc")) == 0
    tree = load_result("out.nc")
    assert tree["posterior"].sizes["draw"] == 30
    assert list(tree["posterior"].dataset["marker"].values) == ["L1A", "L1B"]
    assert provenance(tree)["smoother"] == "laplace"
    parts: dict[str, Any] = {name: np.asarray(tree[name].to_numpy()) for name in ("observed_data/points", "posterior/points")}
    off = parts["observed_data/points"] - parts["posterior/points"].mean((0, 1))
    assert np.nanmedian(np.abs(off)) < 3
    assert set(tree["observed_data"].dataset.data_vars) == {"points", "confidence"}
    wrong = tree["faults"].dataset
    assert wrong["clutter"].dims == ("frame", "camera", "marker") and wrong["swaps"].dims == ("frame", "camera", "limbs")
    places = np.asarray(tree["posterior/markers"].to_numpy())[0]
    apart = np.linalg.norm(places[:, :, 0] - places[:, :, 1], axis=-1)
    assert 0 < (apart.std(1) / apart.mean(1)).max() < 0.1  # each draw has its length
    # other programs get places, and no angles
    assert main(["export", "out.nc", "--format", "trc", "--format", "csv"]) == main(["report", "out.nc"]) == 0
    np.testing.assert_allclose(read_trc("out.trc").positions, tree["summary/markers_mean"], atol=1e-2)
    assert len(Path("out.csv").read_text(encoding="utf-8").splitlines()) == 1 + 12 * 6
    assert main(["export", "out.nc", "--format", "mot"]) == 1
    assert "named points have no joint angles" in capsys.readouterr().err


@pytest.mark.full
def test_lengths_have_the_unit_that_is_given(
    data_dir: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[PointRecording] = []

    def stop(recording: PointRecording, **_: Any) -> None:
        read.append(recording)
        raise InputError("that is all")

    monkeypatch.setattr("poseppl.motion.points.smoothing.smooth_points", stop)
    assert main(words(data_dir)) == main(words(data_dir, "--unit", "mm")) == 1
    metres, millimetres = (np.asarray(each.cameras.centre) for each in read)
    np.testing.assert_allclose(metres, 1000 * millimetres, rtol=1e-5)
    assert capsys.readouterr().err.count("does not state its unit; metres are assumed") == 1


@pytest.mark.full
@pytest.mark.parametrize(
    ("change", "told"),
    [
        (["--skeleton", "none.toml"], "none.toml"),
        (["--skeleton", "legs.toml", "--stature", "1700"], "--stature is an option of poseppl track observations"),
        (["--camera", "Cam-A:offset=3"], "--camera: frames with the same number are simultaneous"),
        (["--keep", "clocks"], "--keep is an option of poseppl track keypoints"),
        (["--filter", "hmc"], "--filter is an option of poseppl track recording"),
        (["--detector", "sleap"], "Cam-A"),
        (["--unit", "feet"], "mm, cm, dm, m, in, or a number of mm"),
        (["--person", "2"], "--person"),
        (["Cam-X=legs.toml"], "Cam-X"),
    ],
)
def test_what_does_not_fit_is_reported(
    data_dir: Path, capsys: pytest.CaptureFixture[str], change: list[str], told: str
) -> None:
    assert main([*words(data_dir), *change, "-o", "out.nc"]) in (1, 2)
    assert told in capsys.readouterr().err
    assert not Path("out.nc").exists()
