"""The command fit-motion on recordings."""

from __future__ import annotations

from pathlib import Path

import pytest

from poseppl.cli import main
from poseppl.motion.learned import read_factored_motion, read_motion_model

pytestmark = pytest.mark.usefixtures("in_own_folder")
SMALL = ["--states", "5", "--components", "3", "--rounds", "3"]


@pytest.fixture
def in_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def refused(capsys: pytest.CaptureFixture[str], arguments: list[str], *words: str) -> None:
    assert main(arguments) == 1
    message = capsys.readouterr().err
    assert all(word in message for word in words), message


def test_recordings_of_two_people_and_rates(capsys: pytest.CaptureFixture[str], data_dir: Path) -> None:
    walk, march = str(data_dir / "cmu_walks" / "16_15.amc"), str(data_dir / "btk_c3d" / "PiG_Motion-FlatFoot-Full.c3d")
    assert main(["fit-motion", "both", walk, march, *SMALL, "--plot", "both.png"]) == 0
    told = capsys.readouterr()
    assert "100 to 120 frames a second: 20 of each are taken" in told.err
    assert "16, PiG_Motion-FlatFoot-Full" in told.out and "variance kept" in told.out
    model = read_motion_model("both.nc")
    assert model.rate == 20.0 and model.provenance["frames"] == [77, 63] and len(model.means) == 5
    assert model.provenance["files"] == [walk, march] and model.body == "poseppl_models.darby.marker_body:full_body"
    assert Path("both.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.full
def test_a_single_walk_as_tables(capsys: pytest.CaptureFixture[str], data_dir: Path) -> None:
    walk = str(data_dir / "cmu_walks" / "16_15.amc")
    assert main(["fit-motion", "walk", walk, "--kind", "factored", "--rate", "30", "--phases", "6"]) == 0
    assert "1.09 m/s" in capsys.readouterr().out
    motion = read_factored_motion("walk.nc")
    assert motion.rate == 30.0 and motion.tables.phases.shape == (6, 6) and len(motion.coordinates) == 31
    assert motion.provenance["file"] == walk and motion.body == "poseppl_models.darby.marker_body:full_body"
    refused(capsys, ["fit-motion", "two", walk, walk, "--kind", "factored"], "2 recordings", "one walk")
    for option in (["--states", "3"], ["--plot", "a.png"]):
        assert main(["fit-motion", "walk", walk, "--kind", "factored", *option]) == 2
        assert f"{option[0]} does not go with --kind factored" in capsys.readouterr().err
    assert main(["fit-motion", "walk", walk, "--phases", "3"]) == 2


@pytest.mark.full
def test_what_cannot_be_learned_from(capsys: pytest.CaptureFixture[str], data_dir: Path) -> None:
    walk = str(data_dir / "cmu_walks" / "16_15.amc")
    refused(capsys, ["fit-motion", "walk", walk, "--rate", "50"], "16_15.amc", "120", "cannot be made 50", "--rate 120, 60")
    refused(capsys, ["fit-motion", "walk", walk, "--rate", "2"], "too few", "--states")
    refused(capsys, ["fit-motion", "walk", walk, "--rate", "20", *SMALL[:2], "--components", "1", "--plot", "a.png"], "--plot")
    Path("walk_01.amc").write_bytes(Path(walk).read_bytes()[:5000])
    skeleton = str(data_dir / "cmu_walks" / "16.asf")
    refused(capsys, ["fit-motion", "walk", f"walk_01.amc,{skeleton}"], "walk_01.amc", "line")
    assert not Path("walk.nc").exists()
