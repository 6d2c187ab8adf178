"""Readability of the report: no label leaves the page at any width, in either theme, and the keyboard moves it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import browser
import pytest
from browser import errors, open_page, picture_of
from rooms import room_result

from poseppl.report import write_report

_REASON = browser.missing()
pytestmark = pytest.mark.skipif(_REASON is not None, reason=f"needs a headless browser: {_REASON}")

_OUTSIDE = """
const wide = document.documentElement.clientWidth, found = [];
for (const text of document.querySelectorAll('.main-svg text')) {
  const box = text.getBoundingClientRect(), plot = text.closest('.js-plotly-plot').getBoundingClientRect();
  if (!box.width || !text.textContent.trim()) continue;
  const beyond = box.left < plot.left - 1 || box.right > plot.right + 1 || box.bottom > plot.bottom + 1;
  if (beyond || box.left < -0.5 || box.right > wide + 0.5)
    found.push([text.closest('.js-plotly-plot').id, text.textContent, box.left, box.right, plot.right]);
}
if (document.documentElement.scrollWidth > wide) found.push(['page', document.documentElement.scrollWidth, wide]);
return found;
"""
_BROKEN = """
const found = [], range = document.createRange();
for (const place of document.querySelectorAll('h1, h2, h3, th, .note, .card span, .settings td:first-child')) {
  const walker = document.createTreeWalker(place, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) for (const word of walker.currentNode.data.matchAll(/[A-Za-z]{1,20}/g)) {
    range.setStart(walker.currentNode, word.index);
    range.setEnd(walker.currentNode, word.index + word[0].length);
    if (new Set([...range.getClientRects()].map((box) => box.top)).size > 1) found.push(word[0]);
  }
}
return found;
"""
"""Words that a line ends within."""
_HIDDEN = "return [...document.querySelectorAll('.scroll')].filter((e) => e.scrollHeight > e.clientHeight + 1).length"
_NARROWED = "document.querySelectorAll('th, h2').forEach((e) => { e.style.width = '20px'; e.style.overflowWrap = 'anywhere'; })"
_KEY = "document.body.dispatchEvent(new KeyboardEvent('keydown', {key: arguments[0], shiftKey: arguments[1], bubbles: true}))"
_FRAME = "return document.getElementById('frame').textContent"
_NAMES = "return document.getElementById('space').data.map((trace) => trace.name)"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "report.html"
    tree = room_result(24, flesh=True)
    tree.attrs["input"] = json.dumps(", ".join(f"/a/folder/of/recordings/with/a/long/name/camera_0{k}/json" for k in (1, 2)))
    write_report(tree, path)
    return path


def _screen(driver: Any, width: int, scheme: str) -> None:
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", media)


@pytest.mark.full
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_no_label_leaves_the_page(driver: Any, report: Path, width: int, scheme: str) -> None:
    _screen(driver, width, scheme)
    open_page(driver, report)
    assert driver.execute_script(_OUTSIDE) == []
    ground = picture_of(driver, "chart-residuals")[2, 2].mean()
    assert ground > 240 if scheme == "light" else ground < 60
    driver.execute_script("document.querySelector('#chart-residuals .xtitle').setAttribute('x', arguments[0])", width)
    assert driver.execute_script(_OUTSIDE) != [], "a label outside would be found"
    assert errors(driver) == []


@pytest.mark.full
@pytest.mark.parametrize("width", [1280, 390])
def test_no_word_is_broken_and_no_row_hidden(driver: Any, report: Path, width: int) -> None:
    _screen(driver, width, "light")
    open_page(driver, report)
    assert driver.execute_script(_BROKEN) == [] and driver.execute_script(_HIDDEN) == 0
    assert driver.execute_script("return document.querySelector('h1').textContent") == "camera_01/json, camera_02/json"
    driver.execute_script(_NARROWED)
    assert driver.execute_script(_BROKEN) != [], "a broken word would be found"


@pytest.mark.full
def test_keys_move_the_poses(driver: Any, report: Path) -> None:
    _screen(driver, 1280, "light")
    open_page(driver, report)
    assert driver.execute_script(_FRAME) == "frame 22"
    for key, shift, expected in (
        ("ArrowRight", False, 23),
        ("ArrowRight", True, 33),
        ("ArrowLeft", False, 32),
        ("ArrowLeft", True, 22),
    ):
        driver.execute_script(_KEY, key, shift)
        assert driver.execute_script(_FRAME) == f"frame {expected}"
    driver.execute_script(_KEY, "c", False)
    assert (
        driver.execute_script("return document.getElementById('camera').selectedOptions[0].text") == "a camera with a long name"
    )
    names = driver.execute_script(_NAMES)
    assert {"body at the mean", "floor", "observed rays"} <= set(names) and "cameras" not in names
    before = picture_of(driver, "space")
    driver.execute_script(_KEY, "v", False)
    assert "cameras" in driver.execute_script(_NAMES)
    assert abs(picture_of(driver, "space") - before).max(axis=-1).mean() > 1
    driver.execute_script("document.getElementById('rays').click()")
    assert "observed rays" not in driver.execute_script(_NAMES)
    assert errors(driver) == []


@pytest.mark.full
def test_flesh_is_as_thick_as_its_parts(driver: Any, report: Path) -> None:
    _screen(driver, 1280, "light")
    open_page(driver, report)
    mesh = driver.execute_script("return document.getElementById('space').data.find((trace) => trace.type === 'mesh3d')")
    mean = room_result(24, flesh=True)["flesh"]
    base, head = mean["base"].values[12, 0], mean["base"].values[12, 1]
    trunk = [value - base[1] for value in mesh["y"][14:28]]
    assert max(trunk) == pytest.approx(120 * 1.3, rel=0.01)  # its x, along y of the room, is the wider one
    assert max(mesh["z"]) - head[2] == pytest.approx(110, abs=1)
    assert len(mesh["i"]) == 14 * 2 * (3 + 11)
