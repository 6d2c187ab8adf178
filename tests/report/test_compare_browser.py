"""The page of a comparison in a real browser without a network: no script error, and the selects change the pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import browser
import numpy as np
import pytest
from browser import errors, open_page, picture_of
from same_data import DOFS, run_on, scene

from poseppl.diagnostics import compare
from poseppl.report import write_comparison

_REASON = browser.missing()
pytestmark = pytest.mark.skipif(_REASON is not None, reason=f"needs a headless browser: {_REASON}")

_CHOOSE = (
    "const s = document.getElementById(arguments[0]); s.selectedIndex = arguments[1]; s.dispatchEvent(new Event('change'));"
)
DATA = scene(num_frames=30)


@pytest.mark.full
def test_heat_maps_are_drawn_and_change_with_the_figure(driver: Any, tmp_path: Path) -> None:
    comparison = compare(
        {
            "slow <i>": run_on(DATA, rho=0.8),
            "quick": run_on(DATA, seed=1),
            "kalman": run_on(DATA, method="kalman", weighted=1000.0, evaluations=(1, 1)),
        }
    )
    write_comparison(comparison, tmp_path / "page.html")
    open_page(driver, tmp_path / "page.html")
    z = driver.execute_script("return document.getElementById('heat').data.map((trace) => trace.z)")
    tau = comparison["figures"]["tau"].transpose("run", "state_dim", "frame").values
    np.testing.assert_allclose(np.array(z[:2]), np.log10(tau[:2]), atol=0.003)
    assert all(value is None for line in z[2] for value in line)
    before = picture_of(driver, "heat")
    height, width = before.shape[:2]
    slow, quick = before[: height // 2, 120 : width // 2 - 60], before[: height // 2, width // 2 + 40 : width - 160]
    assert slow.mean() < quick.mean() - 10, "a larger inefficiency is darker"
    driver.execute_script(_CHOOSE, "quantity", "4")
    assert driver.execute_script("return document.getElementById('heat').layout.coloraxis.colorbar.title.text") == "R-hat"
    assert (np.abs(picture_of(driver, "heat") - before).max(axis=-1) > 30).mean() > 0.02
    names = driver.execute_script("return [...document.querySelectorAll('#heat .annotation-text')].map((t) => t.textContent)")
    assert any("slow <i>" in name for name in names) and any("closed form" in name for name in names)
    assert driver.execute_script("return document.querySelectorAll('#runs i, #verdicts i').length") == 0
    assert errors(driver) == []


@pytest.mark.full
def test_variance_against_time_by_setting_and_seed(driver: Any, tmp_path: Path) -> None:
    shapes = {"short": (4, 20), "long": (4, 80)}
    runs = {
        f"{name} {seed}": run_on(DATA, seed=10 * seed + shape[1], shape=shape, seconds=shape[1] / 400)
        for name, shape in shapes.items()
        for seed in range(3)
    } | {"other": run_on(DATA, method="assumed-density", seed=9)}
    comparison = compare(runs)
    write_comparison(comparison, tmp_path / "page.html")
    open_page(driver, tmp_path / "page.html")
    script = """return document.getElementById('variance-chart').data.map(
      (t) => [t.name, t.x, t.y, t.marker.symbol, t.error_y.array]);"""
    traces = driver.execute_script(script)
    kinds = "const l = document.getElementById('variance-chart').layout; return [l.xaxis.type, l.yaxis.type];"
    assert driver.execute_script(kinds) == ["log", "log"]
    points = comparison["variance"].dataset
    assert [trace[0] for trace in traces] == ["hmc", "assumed-density"]
    np.testing.assert_allclose(traces[0][1], points["seconds"][:2], rtol=1e-4)
    np.testing.assert_allclose(traces[0][2], points["variance"][:2], rtol=1e-4)
    assert traces[0][3] == ["circle", "circle"] and traces[1][3] == ["circle-open"]
    bars = points["variance"] * (np.exp(2 * points["variance_se"] / points["variance"]) - 1)
    np.testing.assert_allclose(traces[0][4], bars[:2], rtol=1e-3)
    before = picture_of(driver, "variance-chart")
    assert before.std() > 5
    driver.execute_script(_CHOOSE, "place", "2")
    np.testing.assert_allclose(
        driver.execute_script(script)[0][2], points["variance_by_state_dim"].sel(state_dim=DOFS[1])[:2], rtol=1e-4
    )
    assert (np.abs(picture_of(driver, "variance-chart") - before).max(axis=-1) > 30).mean() > 0.001
    assert errors(driver) == []


@pytest.mark.full
def test_the_page_reads_at_a_glance(driver: Any, tmp_path: Path) -> None:
    """Every chart is drawn, nothing is wider than the page, and axes carry units."""
    write_comparison(compare({"a": run_on(DATA), "b": run_on(DATA, seed=1, rho=0.5)}), tmp_path / "page.html")
    open_page(driver, tmp_path / "page.html")
    drawn = driver.execute_script("return [...document.querySelectorAll('.main-svg')].length")
    assert drawn >= 6
    assert driver.execute_script("return document.documentElement.scrollWidth <= window.innerWidth")
    titles = driver.execute_script(
        "return [...document.querySelectorAll('[class*=title] text, text[class*=title]')].map((t) => t.textContent)"
    )
    for title in ("ESS per second", "mean joint error, mm", "seconds a frame", "frame", "truth inside (%)", "rejected (%)"):
        assert title in titles
    cells = driver.execute_script(
        "return [...document.querySelectorAll('#where tbody tr')].map((r) => r.innerText.split('\\t'))"
    )
    assert [row[0] for row in cells] == list(DOFS) and all(row[1].startswith("a ") and row[3] for row in cells)
    assert errors(driver) == []


@pytest.mark.full
def test_a_comparison_without_figures_opens_too(driver: Any, tmp_path: Path) -> None:
    runs = {name: run_on(DATA, method="kalman", weighted=9.0, with_truth=False) for name in ("a", "b")}
    write_comparison(compare(runs), tmp_path / "page.html")
    open_page(driver, tmp_path / "page.html")
    assert errors(driver) == []
