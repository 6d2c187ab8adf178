"""Which joints have low confidence, and how cameras err: by hand."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from poseppl.motion.tracking.body_result import BodyNames, body_result
from poseppl.motion.verdicts.doubts import WHOLE, doubts_in_a_row, doubts_of
from poseppl.motion.verdicts.residuals import image_errors

CAMERAS, MARKERS = ("left", "right"), ("hip", "knee", "toe")


def result(
    seen: np.ndarray, *, spread: np.ndarray | None = None, noise: float = 2.0, names: tuple[str, ...] = MARKERS, root: str = ""
) -> xr.DataTree:
    """Points (T, 2, K, 2) seen where (100, 200) are expected; the markers' positions have these standard deviations (T, K).

    The last standard deviation is that of a shift which all markers share.
    """
    frames, number = len(seen), len(names)
    wide = np.full((frames, number + 1), 3.0) if spread is None else spread
    # four draws on the vertices of a tetrahedron, of variance 1 along each axis, and its mirror image, which is independent
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
    own, shared = np.kron(corners, np.ones((4, 1))) / 3**0.5, np.kron(np.ones((4, 1)), -corners) / 3**0.5
    markers = wide[None, :, :-1, None] * own[:, None, None] + wide[None, :, -1:, None] * shared[:, None, None]
    return body_result(
        state=np.zeros((1, 16, frames, 1)),
        names=BodyNames(("x",), names, CAMERAS),
        extras={"markers": markers[None], "points": np.broadcast_to([100.0, 200.0], (1, 16, frames, 2, number, 2))},
        observed={"points": seen},
        inputs={"noise": np.full((2, number), noise)},
        frames=np.arange(10, 10 + frames),
        root=root or None,
    )


def clean(frames: int = 8, number: int = 3) -> np.ndarray:
    seen = np.tile([100.0, 200.0], (frames, 2, number, 1))
    seen[:, :, 2] = np.nan  # no camera ever sees the third one
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
        (("knee",), 12, 13, 2, "seen by one camera only"),
        (("hip",), 16, 16, 1, "far from its detections in right"),
        (("knee",), 14, 14, 1, "seen by no camera"),
    ]


RELATIVE = "posterior SD above 60 mm, relative to hip"


def test_positions_are_judged_relative_to_the_root_and_what_they_share_is_said_once() -> None:
    """The root's own standard deviation is hypot(3, 90) mm; the others' is what they have beyond it."""
    spread = np.full((8, 4), 3.0)
    spread[:, 3] = 90.0  # of all of them
    spread[1:4, 2] = 64.5  # the toe's, 61.5 beyond the hip's
    spread[5:7, 1:3] = 70.0
    spread[0, 1] = 62.5  # the knee's, 59.5 beyond the hip's
    tree = result(clean(), spread=spread, root="hip")
    found = [
        ((WHOLE,), 10, 17, 8, "posterior SD of hip above 60 mm"),
        (("toe",), 11, 13, 3, RELATIVE),
        (("knee", "toe"), 15, 16, 2, RELATIVE),
    ]
    assert rows(tree) == found
    doubts = doubts_of(tree)
    assert doubts is not None and doubts.root == "hip"
    np.testing.assert_allclose(doubts.spread[2], [0, 0, 61.5, np.hypot(3, 90)], atol=1e-9)


def test_without_a_root_positions_are_judged_relative_to_the_centre() -> None:
    spread = np.zeros((8, 4))
    spread[2, 1], spread[:, 3] = 99.0, 61.0
    seen = clean()
    seen[3, :, 1] = np.nan
    tree = result(seen, spread=spread)
    where = "the centre of all points"
    assert rows(tree) == [
        ((WHOLE,), 10, 17, 8, f"posterior SD of {where} above 60 mm"),
        (("knee",), 12, 12, 1, f"posterior SD above 60 mm, relative to {where}"),
        (("knee",), 13, 13, 1, "seen by no camera"),
    ]


NAMES = ("hip", "knee", "toe", "ankle", "elbow", "wrist", "neck")


def test_an_error_that_all_points_of_a_camera_share_is_said_once() -> None:
    """A camera is shifted by 30 px in all frames, and a joint is off by 20 px beyond that in two of them."""
    seen = clean(number=len(NAMES))
    seen[:, 1] += [30.0, 0.0]
    seen[4:6, 1, 5] += [0.0, 20.0]
    assert rows(result(seen, names=NAMES)) == [
        ((WHOLE,), 10, 17, 8, "far from all detections in right"),
        (("wrist",), 14, 15, 2, "far from its detections in right"),
    ]


def test_frames_in_which_a_camera_saw_nobody_are_said_once() -> None:
    seen = clean(number=len(NAMES))
    seen[3:5, 0] = np.nan
    seen[6, 0, :2] = np.nan
    assert rows(result(seen, names=NAMES)) == [
        ((WHOLE,), 13, 14, 2, "seen by one camera only"),
        (("hip", "knee"), 16, 16, 1, "seen by one camera only"),
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
    bare = body_result(state=np.zeros((1, 5, 3, 1)), names=BodyNames(("level",)))
    assert image_errors(bare) is None and doubts_of(bare) is None
