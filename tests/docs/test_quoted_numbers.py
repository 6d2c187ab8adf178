"""Numbers that guides quote from tables on other pages."""

from __future__ import annotations

import pytest

from studies.verdicts import default_filter, keypoints
from studies.verdicts.pages import DOCS, read_tables

TABLES = read_tables()


def prose_of(page: str) -> str:
    """A page with single spaces."""
    return " ".join((DOCS / page).read_text(encoding="utf-8").split())


def test_errors_of_keypoints_in_two_cameras() -> None:
    pairs = [TABLES["keypoints"].records(cameras=cameras, method=keypoints.DEFAULT)[0] for cameras in ("1-4", "2-4")]
    wide, narrow = (f"{row['median']:.1f} mm" for row in pairs)
    text = prose_of("keypoints.md")
    assert f"is {wide} with two cameras at a wide angle, and {narrow} at a narrow one" in text
    shares = " and ".join(f"{100 * row['coverage_90']:.1f}" for row in pairs)
    assert f"coverage of 90 % intervals is {shares} %" in text


def test_both_default_filters_with_four_cameras_of_keypoints() -> None:
    errors = {row["part"]: f"{row['error']:.0f} mm" for row in TABLES["keypoint_speed"].records()}
    kalman, assumed = errors["filter, Kalman"], errors["filter, assumed density"]
    assert f"error of the Kalman filter is {kalman}, that of the assumed-density filter {assumed}" in prose_of("choosing.md")


def test_both_default_filters_with_markers() -> None:
    rows, text = TABLES["default_filter"].records(), prose_of("choosing.md")
    for cameras in (1, 2):
        kalman, assumed = (default_filter.cells_of(rows, cameras, name) for name in ("kalman", "assumed-density"))
        nearer = float(kalman[6].split()[0]) - float(assumed[6].split()[0])
        assert round(nearer) in (2, 3) and "2 to 3 points nearer to 90 %" in text
        assert int(kalman[8]) / int(assumed[8]) == pytest.approx(6, abs=0.6) and "six times as fast" in text
    assert round(float(assumed[5].split()[0])) == -1 and "with two cameras they differ by 1 mm" in text


def test_gains_of_smoothing_by_cameras() -> None:
    text = (DOCS / "validation" / "smoothing.md").read_text(encoding="utf-8")
    gains = {
        cameras: [
            int(line.split("|")[5].split()[0])
            for line in text.splitlines()
            if line.startswith(f"| points | {cameras} |") and "| filter |" not in line
        ]
        for cameras in (1, 4)
    }
    said = prose_of("choosing.md")
    assert f"with one camera it removed {min(gains[1])} to {max(gains[1])} % of the error" in said
    assert f"with four cameras {min(gains[4])} to {max(gains[4])} %" in said
