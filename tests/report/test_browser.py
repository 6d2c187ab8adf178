"""The report in a real browser without a network: no script error, the slider moves, and the pictures change with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import browser
import numpy as np
import pytest
import xarray as xr
from browser import errors, open_page, picture_of
from hostile import HOSTILE, telling
from synthetic import predicted_result, synthetic_result, two_sided_result
from waiting import wait_until

from poseppl.cli import main
from poseppl.diagnostics import diagnose
from poseppl.report import write_report
from poseppl.runs.results import load_result

_REASON = browser.missing()
pytestmark = pytest.mark.skipif(_REASON is not None, reason=f"needs a headless browser: {_REASON}")

_MOVE = """
const slider = document.getElementById("slider");
slider.value = arguments[0];
slider.dispatchEvent(new Event("input"));
"""
_INSERT = """
document.addEventListener("error", () => setTimeout(arguments[1]), true);
document.body.insertAdjacentHTML("beforeend", arguments[0]);
"""
"""Insert a picture that cannot be loaded, and return when its error has been handled."""
_SPACE = "const t = document.getElementById('space').data; return [t.length, t[1].x.filter((v) => v !== null), t[0].x.length];"


@pytest.mark.full
def test_slider_moves_and_pictures_change(driver: Any, tmp_path: Path) -> None:
    tree = synthetic_result()
    write_report(tree, tmp_path / "report.html")
    open_page(driver, tmp_path / "report.html")
    driver.execute_script(_MOVE, 3)
    assert driver.execute_script("return document.getElementById('frame').textContent") == "frame 13"
    traces, before, width = driver.execute_script(_SPACE)
    assert traces == 5, "draws, mean, joints, truth and floor"
    assert width == 20 * 14 * 3
    edges = tree["body/edges"].values
    np.testing.assert_allclose(before, tree["summary/markers_mean"].values[3, edges.ravel(), 0], atol=0.51)
    pictures = {name: picture_of(driver, name) for name in ("space", "image")}
    for picture in pictures.values():
        assert picture.std() > 5, "something is drawn"

    driver.execute_script(_MOVE, 9)
    assert driver.execute_script("return document.getElementById('frame').textContent") == "frame 19"
    assert driver.execute_script(_SPACE)[1] != before
    for name, picture in pictures.items():
        moved = picture_of(driver, name)
        assert (np.abs(moved - picture).max(axis=-1) > 30).mean() > 0.002, f"the picture {name} did not change"
        assert (np.abs(picture_of(driver, name) - moved).max(axis=-1) > 30).mean() < 0.0005, "it changes only when moved"
    assert errors(driver) == []


@pytest.mark.full
def test_joints_that_are_doubted_are_marked(driver: Any, tmp_path: Path) -> None:
    tree = synthetic_result()
    tree["observed_data/points"][3, :, 5] += 0.5  # far away: the noise is 0.003
    tree["summary/markers_sd"] = 0.1 * tree["summary/markers_sd"]  # one camera knows places to more than 60 mm
    tree["inputs"] = xr.Dataset({"noise": (("a", "b"), np.full(tree["observed_data/points"].shape[1:3], 0.003))})
    write_report(tree, tmp_path / "report.html")
    open_page(driver, tmp_path / "report.html")
    driver.execute_script(_MOVE, 3)
    told = driver.execute_script("return document.getElementById('space').data[2].text")
    assert told[5].endswith(": far from its detections in front")
    marked = driver.execute_script("return document.getElementById('space').data[2].marker.color")
    assert marked[5] == "#e4572e"
    text = driver.execute_script("return ['trust', 'cameras'].map((id) => document.getElementById(id).textContent).join()")
    assert "far from its detections in front" in text and "expected SD" in text
    assert driver.execute_script("return document.getElementById('joint-chart').data.length") == 3 * 4 + 3
    assert driver.execute_script("return document.querySelectorAll('#chart-residuals .main-svg').length") > 0
    assert errors(driver) == []


@pytest.mark.full
def test_play_and_charts(driver: Any, tmp_path: Path) -> None:
    write_report(synthetic_result(num_frames=30), tmp_path / "report.html")
    open_page(driver, tmp_path / "report.html")
    where = "return document.getElementById('slider').value"
    before = driver.execute_script(where)
    driver.execute_script("document.getElementById('play').click()")
    wait_until(lambda: driver.execute_script(where) != before)
    driver.execute_script("document.getElementById('play').click()")
    driver.execute_script(
        "const s = document.getElementById('coordinate'); s.selectedIndex = 4; s.dispatchEvent(new Event('change'));"
    )
    low = driver.execute_script("return document.getElementById('coordinate-chart').data[2].y")
    assert len(low) == 30
    drawn = driver.execute_script("return [...document.querySelectorAll('[id^=chart-] .main-svg')].length")
    assert drawn >= 4
    assert driver.execute_script("return window.alert.toString().includes('native')")
    assert errors(driver) == []


@pytest.mark.full
@pytest.mark.parametrize("arguments", [{"weighted": True, "with_truth": False}, {"num_frames": 1}])
def test_other_results_open_without_an_error(driver: Any, tmp_path: Path, arguments: dict[str, Any]) -> None:
    write_report(synthetic_result(**arguments), tmp_path / "report.html")
    open_page(driver, tmp_path / "report.html")
    assert driver.execute_script("return document.getElementById('space').data.length") == 4 + ("weighted" not in arguments)
    assert errors(driver) == []


@pytest.mark.full
def test_the_histogram_of_predictions_is_drawn(driver: Any, tmp_path: Path) -> None:
    write_report(predicted_result(np.random.default_rng(0).uniform(size=(20, 6))), tmp_path / "report.html")
    open_page(driver, tmp_path / "report.html")
    bars = driver.execute_script("return document.querySelectorAll('#chart-predictions .bars .point').length")
    assert bars == 10 and errors(driver) == []


_NAMES = "return document.getElementById(arguments[0]).data.map((trace) => trace.name);"


@pytest.mark.full
def test_modes_are_ghosts_in_the_frames_that_have_several(driver: Any, tmp_path: Path) -> None:
    write_report(two_sided_result(), tmp_path / "report.html")
    open_page(driver, tmp_path / "report.html")
    driver.execute_script(_MOVE, 7)
    before, shown = picture_of(driver, "space"), driver.execute_script(_NAMES, "space")
    assert shown[-2:] == ["mode 1, 75 %", "mode 2, 25 %"]
    assert driver.execute_script(_NAMES, "chart-modes") == ["mode 1", "mode 2"]
    *cells, apart = [cell.text for cell in driver.find_elements("css selector", "#modes td")]
    assert cells == ["16", "20", "25%", "wrist_r"] and abs(float(apart) - 500) < 60
    driver.execute_script(_MOVE, 2)
    assert driver.execute_script(_NAMES, "space") == shown[:-2]
    assert (np.abs(picture_of(driver, "space") - before).max(axis=-1) > 30).mean() > 0.002
    assert errors(driver) == []


@pytest.mark.full
def test_no_script_of_a_result_runs(driver: Any, tmp_path: Path) -> None:
    write_report(telling(HOSTILE), tmp_path / "report.html")
    open_page(driver, tmp_path / "report.html")
    driver.execute_script(_MOVE, 3)
    assert driver.execute_script("return typeof hacked") == "undefined"
    assert errors(driver) == []
    driver.execute_async_script(_INSERT, HOSTILE[0])
    assert driver.execute_script("return typeof hacked") == "undefined"  # not even if it were not escaped
    wait_until(lambda: any("Content Security Policy" in message for message in errors(driver)))


@pytest.mark.parametrize(
    ("walk", "skeleton", "cameras", "limit"),
    [("02_01", "02", 1, 120.0), ("03_01", "03", 2, 40.0)],
)
@pytest.mark.slow
def test_recorded_walks_are_tracked_and_reported(
    driver: Any, tmp_path: Path, data_dir: Path, walk: str, skeleton: str, cameras: int, limit: float
) -> None:
    """The main job on real input. The limits (mm) are twice what whole recordings gave: 68 and 17."""
    recording, output = data_dir / "cmu_amc" / f"{walk}.amc", tmp_path / "walk.nc"
    options = ["--skeleton", str(data_dir / "cmu_amc" / f"{skeleton}.asf"), "--cameras", str(cameras), "--frames", "40:60"]
    assert main(["track", str(recording), *options, "-o", str(output), "--quiet"]) == 0
    assert main(["report", str(output), "-o", str(tmp_path / "walk.html")]) == 0
    diagnostics = diagnose(load_result(output))["diagnostics"]
    assert float(diagnostics["joint_error"].mean()) < limit
    open_page(driver, tmp_path / "walk.html")
    before = picture_of(driver, "space")
    driver.execute_script(_MOVE, 19)
    assert driver.execute_script("return document.getElementById('frame').textContent") == "frame 59"
    assert (np.abs(picture_of(driver, "space") - before).max(axis=-1) > 30).mean() > 0.002
    assert errors(driver) == []
