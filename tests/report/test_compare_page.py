"""The page of a comparison as text: one file, escaped, bounded, and with the numbers of the table."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from page_reading import data_of
from same_data import run_on, scene

from poseppl.diagnostics import compare, comparison_table
from poseppl.diagnostics.verdicts.comparison import findings, words
from poseppl.report import comparison_html, write_comparison, write_comparison_table
from poseppl.report.compare import HEATS, MAX_CELLS, comparison_charts, heat_maps, variance_charts
from poseppl.report.page import shown, to_json, with_error

DATA = scene(num_frames=20)


@pytest.fixture(scope="module")
def comparison() -> xr.DataTree:
    runs = {
        "hmc <script>alert(1)</script>": run_on(DATA, rho=0.8),
        "quick": run_on(DATA, seed=1, seconds=0.05),
        "kalman": run_on(DATA, method="kalman", weighted=1000.0, evaluations=(1, 1)),
        "wrong": run_on(DATA, method="particle", weighted=40.0, shift=6.0),
    }
    return compare(runs)


def _row(page: str, first: str) -> list[str]:
    """Cells of the first table row that begins with a word."""
    found = re.search(rf"<tr><td[^>]*>(?:<span[^>]*></span>)?{re.escape(first)}</td>.*?</tr>", page)
    assert found
    return [re.sub("<.*?>", "", cell) for cell in re.findall("<td[^>]*>(.*?)</td>", found.group(0))]


@pytest.mark.full
def test_one_file_without_a_network_and_escaped(tmp_path: Path, comparison: xr.DataTree) -> None:
    write_comparison(comparison, tmp_path / "page.html")
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert not re.search(r"<(script|link|img|iframe)[^>]+(src|href)=[\"'](?!data:)", page)
    assert "<script>alert" not in page and "knee<b>" not in page
    assert "hmc &lt;script&gt;alert(1)" in page and "knee&lt;b&gt;.X" in page
    for heading in ("Results", "Winners by coordinate", "Variance against time", "Error and coverage", "Settings"):
        assert f"<h2>{heading}</h2>" in page


@pytest.mark.full
def test_figures_without_a_value_are_dashes_and_win_nothing(comparison: xr.DataTree) -> None:
    page = comparison_html(comparison)
    assert [cell for cell in _row(page, "kalman") if cell == "–"] == ["–"] * 8
    assert _row(page, "wrong").count("–") == 2, "rejection and R-hat; no run has an evidence"
    tau = data_of(page, "charts-data")["heat"]["inefficiency factor τ"]
    assert all(value is None for line in tau["data"][2]["customdata"] for value in line)
    assert tau["data"][3]["name"] == "wrong (miscalibrated)"
    told = [note["text"] for note in tau["layout"]["annotations"] if note["xref"] == "x3 domain"]
    assert told == ["●", "kalman", "closed form: no Monte Carlo error"]
    texts = [found.text for found in findings(comparison)]
    assert any(text.startswith("quick has the highest ESS per second") for text in texts)
    assert any(text.startswith("Wrong posterior") and "wrong (" in text for text in texts)
    assert any(text.startswith("kalman is a closed form") for text in texts)


@pytest.mark.parametrize(
    ("share", "error", "words"),
    [
        (0.83, 0.02, "warning: Overconfident; coverage of 90 % intervals: quick (83 ± 2 %)."),
        (0.96, 0.02, "warning: Underconfident; coverage of 90 % intervals: quick (96 ± 2 %)."),
        (0.89, 0.02, "info: Calibrated; coverage of 90 % intervals: quick (89 ± 2 %)."),
        (0.85, 0.06, "info: The sequence is too short to decide on calibration; coverage of 90 % intervals: quick (85 ± 6 %)."),
    ],
)
def test_runs_are_reported_by_what_their_intervals_cover(
    comparison: xr.DataTree, share: float, error: float, words: str
) -> None:
    tree = comparison.copy(deep=True)
    for name, value in (("coverage_all", share), ("coverage_se_all", error)):
        tree["summary"][name].loc[{"run": "quick"}] = value
        tree["summary"][name].loc[{"run": "kalman"}] = np.nan
        tree["summary"][name].loc[{"run": "hmc <script>alert(1)</script>"}] = np.nan
    assert words in [f"{found.severity}: {found.text}" for found in findings(tree)]


@pytest.mark.full
def test_page_and_table_carry_the_same_numbers(tmp_path: Path, comparison: xr.DataTree) -> None:
    write_comparison_table(comparison, tmp_path / "table.csv")
    with (tmp_path / "table.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 4 * 20 * 3
    expected = comparison_table(comparison)
    for row, want in zip(rows, expected, strict=True):
        assert (row["run"], int(row["frame"]), row["state_dim"]) == (want["run"], want["frame"], want["state_dim"])
        assert row["tau"] == "" if want["tau"] is None else float(row["tau"]) == pytest.approx(want["tau"], rel=1e-5)
    keys = {label: key for key, label, *_ in HEATS}
    for label, part in heat_maps(comparison).items():
        drawn = np.array([trace["customdata"] for trace in part["data"]])
        named = [float(row[keys[label]] or "nan") for row in rows]
        np.testing.assert_allclose(drawn, np.reshape(named, (4, 20, 3)).swapaxes(1, 2), rtol=6e-3)
    summary = comparison["summary"].dataset.sel(run="quick")
    cells = _row(comparison_html(comparison), "quick")
    assert cells[4] == f"{float(summary['rhat_all']):.2f}" and cells[5] == shown(float(summary["tau_median_all"]))
    assert cells[6] == with_error(float(summary["tau_all"]), float(summary["tau_se_all"]))
    assert cells[8:10] == [shown(float(summary[f"ess_per_{unit}_all"])) for unit in ("second", "gradient")]


@pytest.mark.full
def test_charts_are_those_that_there_are_figures_for(comparison: xr.DataTree) -> None:
    assert set(comparison_charts(comparison)) == {
        "cost",
        "error",
        "coverage",
        "progress",
        "autocorrelation",
        "heat",
        "variance",
    }
    closed = {name: run_on(DATA, method="kalman", weighted=9.0, evaluations=(1, 1), with_truth=False) for name in ("a", "b")}
    result = compare(closed)
    assert comparison_charts(result) == {"heat": {}, "variance": {}}
    page = comparison_html(result)
    assert "No winner" in page and 'id="heat"' not in page and 'id="variance-chart"' not in page


@pytest.mark.full
def test_forecasts_stand_side_by_side() -> None:
    runs = {"near": run_on(DATA), "far": run_on(DATA, seed=1), "none": run_on(DATA, seed=2)}
    assert "<h2>Forecasts</h2>" not in comparison_html(compare(runs))
    for name, score in (("near", 0.25), ("far", 2.5)):
        by_lead = {key: (("site", "lead"), [[value] * 9]) for key, value in (("crps", score), ("coverage", 0.9))}
        by_lead |= {key: (("site", "lead"), [[0.02] * 9]) for key in ("crps_error", "coverage_se")}
        by_site = {"overall": (("site",), [0.87]), "overall_se": (("site",), [0.01])}
        runs[name]["hindcasts"] = xr.DataTree(xr.Dataset(by_lead | by_site, {"site": ["y"], "lead": range(1, 10)}))
    page = comparison_html(compare(runs))
    rows = re.findall(r"<tr><td>y</td>.*?</tr>", page)
    cells = [[re.sub("<.*?>", "", cell) for cell in re.findall("<td>(.*?)</td>", row)] for row in rows]
    assert [row[1] for row in cells] == [lead for lead in ("1", "4", "6", "9") for _ in range(2)]
    assert cells[0] == ["y", "1", "near", "0.250 ± 0.020", "90.0 ± 2.0", "87.0 ± 1.0"] and cells[1][2:4] == [
        "far",
        "2.500 ± 0.020",
    ]
    (figure,) = data_of(page, "charts-data")["forecasts"].values()
    assert [trace["name"] for trace in figure["data"]] == ["near", "far"] and figure["data"][1]["y"] == [2.5] * 9


@pytest.mark.full
def test_one_frame_and_many_runs_have_a_page() -> None:
    single = scene(num_frames=1)
    page = comparison_html(compare({"a": run_on(single), "b": run_on(single, seed=1)}))
    assert "tie" in page
    many = compare({f"run {i}": run_on(DATA, seed=i % 4, shape=(2, 8)) for i in range(12)})
    assert "4 seeds" in variance_charts(many)["all coordinates"]["data"][0]["text"][0]
    assert "and 4 more" in comparison_html(many)


@pytest.mark.full
def test_size_is_bounded_on_long_sequences(comparison: xr.DataTree) -> None:
    figures = comparison["figures"].dataset
    frames, dofs, runs = 3000, 28, 6
    places = {"frame": np.arange(frames) % 20, "state_dim": np.arange(dofs) % 3, "run": np.arange(runs) % 4}
    large = figures.isel(places).assign_coords(
        frame=np.arange(frames), state_dim=[f"joint {i}" for i in range(dofs)], run=[f"run {i}" for i in range(runs)]
    )
    tree = xr.DataTree.from_dict({"figures": large, "summary": comparison["summary"].dataset.isel(run=places["run"])})
    heat = heat_maps(tree)
    shown = heat["ESS"]["data"][0]["x"]
    assert len(shown) == 300 and shown[-1] == 2999
    assert len(shown) * dofs * runs <= MAX_CELLS
    assert len(to_json(heat)) < 4_000_000


@pytest.mark.full
def test_numbers_and_names_in_words() -> None:
    given = (9032.065, 35.4, 2.008, 0.00641, 0.00011, 1.2e12, np.nan, 0.0)
    assert [shown(value) for value in given] == ["9,030", "35", "2", "0.0064", "1.1e-4", "1.2e12", "–", "0"]
    assert [words(["a"]), words(["a", "b"]), words(["a", "b", "c"])] == ["a", "a and b", "a, b and c"]
    assert words([str(i) for i in range(10)]) == "0, 1, 2, 3, 4, 5, 6, 7 and 2 more"
