"""`poseppl export`, and the files that `poseppl track --keypoints` leaves for other programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drawn_bodies import drawn_result
from poseppl_models.bodies.choo_fleet import full_body

from poseppl.cli import main
from poseppl.cli.export import FORMATS
from poseppl.files.exchange_formats import ENDS
from poseppl.motion.io.trc import read_trc
from poseppl.runs.results import save_result


@pytest.fixture(autouse=True)
def _files(here: None, tmp_path: Path) -> None:
    rest = np.asarray(full_body().rest)
    tree = drawn_result(np.tile(rest, (3, 1)), np.full(len(rest), 0.02), np.arange(3), None, num_draws=20)
    save_result(tree, tmp_path / "walk.nc")


def test_files_beside_the_result(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "walk.nc"]) == 0
    out, err = capsys.readouterr()
    assert out.split() == ["walk.trc", "walk_lower.trc", "walk_upper.trc", "walk.mot", "walk.osim"]
    assert all(Path(name).is_file() for name in out.split())
    assert "exported times assume 30 frames a second" in err


@pytest.mark.full
def test_formats_one_after_another(capsys: pytest.CaptureFixture[str]) -> None:
    Path("out").mkdir()
    assert main(["export", "--format", "trc", "csv", "walk.nc", "--output", "out", "--level", "0.5", "-q"]) == 0
    assert capsys.readouterr().out == ""
    assert sorted(path.name for path in Path("out").iterdir()) == ["walk.csv", "walk.trc", "walk_lower.trc", "walk_upper.trc"]
    assert main(["export", "walk.nc", "--format", "trc"]) == 0
    half, most = (read_trc(Path(folder) / "walk_lower.trc").positions for folder in ("out", "."))
    # three standard deviations on this side of the mean with 90 %, 1.3 with 50 %; the second axis is turned round
    assert (half[..., [0, 2]] >= most[..., [0, 2]]).all() and (half[..., 1] <= most[..., 1]).all()


@pytest.mark.full
@pytest.mark.parametrize(
    ("words", "status", "expected"),
    [
        (["--format", "fbx"], 2, "'fbx' is not one of"),
        (["--format"], 2, "requires an argument"),
        (["--level", "90"], 1, "--level: 90 (expected a share"),
        (["--output", "nowhere"], 1, "not a folder"),
    ],
)
def test_what_does_not_fit_is_reported(
    capsys: pytest.CaptureFixture[str], words: list[str], status: int, expected: str
) -> None:
    assert main(["export", "walk.nc", *words]) == status
    assert expected in capsys.readouterr().err
    assert sorted(path.name for path in Path().iterdir()) == ["walk.nc"]


@pytest.mark.full
def test_the_same_formats_are_known_to_click() -> None:
    assert tuple(ENDS) == FORMATS
