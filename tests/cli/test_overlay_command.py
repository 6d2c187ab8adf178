"""`poseppl overlay`: skeletons where the result has them, over pictures that are otherwise as they were."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from poseppl.cli import main
from poseppl.motion.io import open_video, write_video
from poseppl.motion.tracking.body_result import BodyNames, body_result
from poseppl.runs.results import save_result

GRAY, SIZE = 90, (64, 48)
PLACES = np.array([[[10.0, 12.0], [40.0, 12.0]], [[10.0, 30.0], [40.0, 30.0]]])
"""Both markers in frames 1 and 3; a level line between them."""


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    draws = np.broadcast_to(PLACES[None, None, :, None], (1, 5, 2, 1, 2, 2))
    tree = body_result(
        state=np.zeros((1, 5, 2, 1)),
        names=BodyNames(["x"], ["a", "b"], ["cam"]),
        extras={"points": draws},
        edges=np.array([[0, 1]]),
        frames=np.array([1, 3]),
        rate=10.0,
    )
    save_result(tree, "walk.nc")
    write_video("film.mp4", [np.full((SIZE[1], SIZE[0], 3), GRAY, np.uint8)] * 5, 10.0)


@pytest.mark.full
def test_lines_are_where_the_result_has_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["overlay", "walk.nc", "cam=film.mp4"]) == 0
    assert capsys.readouterr().out.split() == ["walk-cam.mp4"]
    images = np.stack(list(open_video("walk-cam.mp4", "cam").images())).astype(int)
    assert images.shape == (2, SIZE[1], SIZE[0], 3)
    changed = np.abs(images - GRAY).max(-1) > 60
    for frame, (left, right) in enumerate(PLACES):
        rows, columns = np.nonzero(changed[frame])
        assert abs(rows.mean() - left[1]) < 1 and abs(columns.min() - left[0]) < 3 and abs(columns.max() - right[0]) < 3


@pytest.mark.full
def test_the_folder_is_chosen() -> None:
    Path("out").mkdir()
    assert main(["overlay", "walk.nc", "cam=film.mp4", "-o", "out", "-q"]) == 0
    assert sorted(path.name for path in Path().rglob("*.mp4")) == ["film.mp4", "walk-cam.mp4"]
    assert Path("out/walk-cam.mp4").is_file()


@pytest.mark.full
@pytest.mark.parametrize(
    ("words", "status", "expected"),
    [
        ([], 2, "Missing argument"),
        (["film.mp4"], 1, "no points of the camera 'film' (expected one of"),
        (["cam=none.mp4"], 1, "none.mp4"),
        (["cam=film.mp4", "cam=film.mp4"], 1, "two videos of the camera 'cam'"),
        (["cam=film.mp4", "--output", "nowhere"], 1, "not a folder"),
    ],
)
def test_what_does_not_fit_is_reported(
    capsys: pytest.CaptureFixture[str], words: list[str], status: int, expected: str
) -> None:
    assert main(["overlay", "walk.nc", *words]) == status
    assert expected in capsys.readouterr().err
    assert sorted(path.name for path in Path().iterdir()) == ["film.mp4", "walk.nc"]


def test_a_video_that_ends_early_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    write_video("short.mp4", [np.full((SIZE[1], SIZE[0], 3), GRAY, np.uint8)] * 2, 10.0)
    assert main(["overlay", "walk.nc", "cam=short.mp4"]) == 1
    assert "short.mp4" in capsys.readouterr().err
    assert not Path("walk-cam.mp4").exists()
