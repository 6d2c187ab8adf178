"""Which joints not to trust, and how cameras err: by hand."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from poseppl.diagnostics.doubts import doubts_in_a_row, doubts_of
from poseppl.diagnostics.image_errors import image_errors
from poseppl.runs.results import Names, build_result

CAMERAS, MARKERS = ("left", "right"), ("hip", "knee", "toe")


def result(seen: np.ndarray, *, spread: np.ndarray | None = None, noise: float = 2.0) -> xr.DataTree:
    """Points (T, 2, 3, 2) seen where (100, 200) are expected, with a place known to 5 mm in each of x, y and z."""
    frames = len(seen)
    markers = np.zeros((1, 4, frames, 3, 3))
    sd = np.full((frames, 3, 3), 5.0) if spread is None else np.broadcast_to(spread[:, :, None], (frames, 3, 3)) / 3**0.5
    quantile = np.zeros((frames, 7, 3, 3))
    return build_result(
        state=np.zeros((1, 4, frames, 1)),
        names=Names(("x",), MARKERS, CAMERAS),
        extras={"markers": markers, "points": np.broadcast_to([100.0, 200.0], (1, 4, frames, 2, 3, 2))},
        summary={"markers_mean": markers[0, 0], "markers_sd": sd, "markers_quantile": quantile},
        observed=seen,
        inputs={"noise": np.full((2, 3), noise)},
        frames=np.arange(10, 10 + frames),
    )


def clean(frames: int = 8) -> np.ndarray:
    seen = np.tile([100.0, 200.0], (frames, 2, 3, 1))
    seen[:, :, 2] = np.nan  # no camera ever sees the toe
    return seen


def rows(tree: xr.DataTree) -> list[tuple[object, ...]]:
    doubts = doubts_of(tree)
    assert doubts is not None
    return [each[:5] for each in doubts_in_a_row(tree, doubts)]


def test_nothing_is_doubted_where_two_cameras_agree() -> None:
    tree = result(clean())
    assert rows(tree) == []
    doubts = doubts_of(tree)
    assert doubts is not None and doubts.unseen == ["toe"]


def test_reasons_in_a_row() -> None:
    seen = clean()
    seen[2:5, 0, 1] = np.nan
    seen[4, 1, 1] = np.nan
    seen[6, 1, 0] += [6.0, 6.0]  # 8.5 px: more than four times 2
    seen[7, 1, 0] += [5.0, 5.0]  # 7.1 px: less
    assert rows(result(seen)) == [
        ("knee", 12, 13, 2, "seen by one camera alone"),
        ("hip", 16, 16, 1, "far from where right saw it"),
        ("knee", 14, 14, 1, "seen by no camera"),
    ]


def test_a_wide_place_is_doubted_unless_there_is_more_to_say() -> None:
    spread = np.full((8, 3), 10.0)
    spread[1:4, 2] = 61.0
    spread[0, 1] = 70.0
    seen = clean()
    seen[0, :, 1] = np.nan
    assert rows(result(seen, spread=spread)) == [
        ("toe", 11, 13, 3, "known to more than 60 mm"),
        ("knee", 10, 10, 1, "seen by no camera"),
    ]


def test_errors_by_camera() -> None:
    rng = np.random.default_rng(0)
    seen = clean(4000) + rng.normal(0.0, 3.0, (4000, 2, 3, 2))
    seen[:, 1] += [4.0, -2.0]
    errors = image_errors(result(seen))
    assert errors is not None
    five = 5 * 1.2533 * 3.0 / 8000**0.5  # five standard errors of a median
    np.testing.assert_allclose(errors.bias, [[0, 0], [4, -2]], atol=five)
    np.testing.assert_allclose(errors.spread, 3.0, atol=5 * 1.17 * 3.0 / 16000**0.5)
    assert (errors.noise == 2.0).all()


@pytest.mark.full
def test_results_without_points_have_none() -> None:
    bare = build_result(state=np.zeros((1, 5, 3, 1)), names=Names(("level",)))
    assert image_errors(bare) is None and doubts_of(bare) is None
