"""Numbers that guides quote from tables on other pages."""

from __future__ import annotations

from importlib.resources import files
from statistics import fmean

import pytest

from studies.verdicts import default_filter, gait, keypoints
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


def test_coverage_of_held_out_cameras() -> None:
    rows = [row for row in TABLES["held_out_cameras"].records() if str(row["cameras"]).count("-") == 1]
    shares = {
        name: 100 * fmean(row["coverage_90"] for row in rows if row["detector"] == name)
        for name in ("OpenPose", "MediaPipe", "MoveNet")
    }
    told = (
        "{OpenPose:.0f} % of OpenPose's keypoints in the other cameras, {MediaPipe:.0f} % of MediaPipe's, and {MoveNet:.0f} %"
    )
    assert told.format(**shares) in prose_of("keypoints.md")


def test_coverage_of_feet_and_face() -> None:
    text = prose_of("keypoints.md")
    for row in TABLES["feet"].records():
        errors = f"{row['median']:.0f} | {row['percentile_95']:.0f}"
        shares = f"{100 * row['coverage_50']:.0f} % | {100 * row['coverage_90']:.0f} %"
        assert f"| {row['detector']} | {row['markers']} | {errors} | {shares} |" in text


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


def test_gait_events_against_force_plates() -> None:
    def early(figure: str, method: str = gait.CAMERAS, share: float = 0.5) -> str:
        rows = gait.records(TABLES, figure, "force plate", method, share)
        late, *others = sorted(-row["bias"] for row in rows if row["person"] != "all")
        assert len(others) == 1
        return f"{late:.0f} to {others[0]:.0f} ms"

    text, guide = prose_of("validation/keypoints.md"), prose_of("gait.md")
    page = " ".join((files("poseppl") / "motion/report/templates/gait.html").read_text().split())
    assert f"come {early(gait.STRIKES)} before a force plate's (2 people, 5 strikes)" in text
    assert f"feels a heel {early(gait.STRIKES)} later** (2 people, 5 strikes)" in guide
    assert f"feels a heel strike {early(gait.STRIKES)} later (two people, 5 strikes)" in page
    assert f"With the foremost heel alone they come {early(gait.STRIKES, share=1.0)} before" in text
    assert f"the default is {early(gait.STRIKES, 'markers')} early" in text
    assert f"**Toe-offs** come {early(gait.OFFS)} before a plate's" in text


def test_coverage_of_gait_events() -> None:
    def inside(figure: str) -> str:
        rows = [row for row in gait.records(TABLES, figure, "force plate") if row["person"] != "all"]
        return f"{sum(row['number'] * row['coverage_90'] for row in rows):.0f} of {sum(row['number'] for row in rows)}"

    said = f"{inside(gait.STRIKES)} contain a plate's heel strike, and {inside(gait.OFFS)} its toe-off"
    assert said in prose_of("validation/keypoints.md")


def test_mean_times_of_steps_and_strides() -> None:
    assert "nearly cancels in mean times" in prose_of("validation/keypoints.md")
    for figure in ("step time, ms", "stride time, ms"):
        rows = gait.records(TABLES, figure, "laboratory")
        assert len(rows) == 3 and max(abs(row["bias"]) for row in rows) < 8  # a strike's is 11 to 19
