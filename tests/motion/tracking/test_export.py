"""A result in the files of other programs."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from drawn_bodies import drawn_result
from poseppl_models.bodies.choo_fleet import full_body

from poseppl.errors import InputError
from poseppl.motion.io.c3d import load_ezc3d, read_c3d
from poseppl.motion.io.opensim_files import read_mot
from poseppl.motion.io.trc import read_trc
from poseppl.motion.tracking.estimates import angle_estimates, clock_of
from poseppl.motion.tracking.export import export
from poseppl.runs.results import Names, build_result

FRAMES = np.arange(6, 18, 3)


def result(body_name: str = "full_body", rate: float | None = 20.0) -> xr.DataTree:
    """200 draws around a pose that walks, of four frames of every third."""
    rest = np.asarray(full_body().rest)
    poses = rest + np.outer(np.arange(4), np.eye(len(rest))[0] * 50.0)
    return drawn_result(poses, np.where(np.arange(len(rest)) < 3, 12.0, 0.05), FRAMES, rate, body_name=body_name)


@pytest.fixture(scope="module")
def tree() -> xr.DataTree:
    return result()


@pytest.fixture(scope="module")
def folder(tree: xr.DataTree, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("export")
    files = export(tree, place, "walk", ("trc", "mot", "c3d", "csv"))
    assert sorted(place.iterdir()) == sorted(files)
    assert [path.name for path in files] == ["walk.trc", "walk_lower.trc", "walk_upper.trc", "walk.mot", "walk.c3d", "walk.csv"]
    return place


def test_places_and_their_intervals(tree: xr.DataTree, folder: Path) -> None:
    summary = tree["summary"].dataset
    mean = read_trc(folder / "walk.trc")
    np.testing.assert_allclose(mean.positions, summary["markers_mean"], atol=1e-3)
    assert (mean.names, mean.rate) == (tuple(full_body().tree.marker_names), 20.0)
    text = {part: np.loadtxt(folder / f"walk{part}.trc", skiprows=6) for part in ("_lower", "", "_upper")}
    for values in text.values():
        np.testing.assert_allclose(values[:, :2], np.stack([FRAMES, FRAMES / 60.0], 1), atol=1e-6)
    assert (text["_lower"][:, 2:] < text[""][:, 2:]).all() and (text[""][:, 2:] < text["_upper"][:, 2:]).all()
    # # y up: the third coordinate is our second one with the opposite sign, and so are its ends
    ends = summary["markers_quantile"].sel(quantile=[0.05, 0.95]).values
    np.testing.assert_allclose(text["_lower"][:, 4], -ends[:, 1, 0, 1], atol=1e-3)
    np.testing.assert_allclose(text["_upper"][:, 3], ends[:, 1, 0, 2], atol=1e-3)


def test_angles(folder: Path) -> None:
    found = read_mot(folder / "walk.mot")
    assert found.in_degrees and not any(np.isnan(values).any() for values in found.columns.values())
    np.testing.assert_allclose(found.times, FRAMES / 60.0)
    five_errors = 5 * np.rad2deg(0.05) / 200**0.5
    np.testing.assert_allclose(found.columns["knee_angle_r"], np.rad2deg(0.2), atol=five_errors)
    np.testing.assert_allclose(np.diff(found.columns["pelvis_tx"]), 0.05, atol=5 * 0.012 * 2**0.5 / 200**0.5)


def test_residuals_are_the_spread(tree: xr.DataTree, folder: Path) -> None:
    assert read_c3d(folder / "walk.c3d").names == tuple(full_body().tree.marker_names)
    spread = np.linalg.norm(tree["summary/markers_sd"].values, axis=-1)
    residuals = load_ezc3d().c3d(str(folder / "walk.c3d"))["data"]["meta_points"]["residuals"][0].T
    np.testing.assert_allclose(residuals, spread, atol=spread.max() / 250)


def test_rows(folder: Path) -> None:
    with (folder / "walk.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 4 * (17 * 3 + 29)
    for row in rows:
        numbers = [float(row[name]) for name in ("lower", "mean", "upper", "sd", "time")]
        assert numbers[0] <= numbers[1] <= numbers[2] and numbers[3] >= 0 and np.isfinite(numbers).all()
    first = rows[0]
    assert [first[name] for name in ("frame", "time", "joint", "coordinate", "unit")] == ["6", "0.1", "pelvis", "x", "mm"]
    knee = next(row for row in rows if row["coordinate"] == "knee_angle_r")
    assert (knee["joint"], knee["unit"]) == ("knee_r", "degrees")
    assert abs(float(knee["upper"]) - float(knee["lower"]) - 2 * 1.645 * np.rad2deg(0.05)) < 5 * np.rad2deg(0.05) * 3 / 200**0.5


def test_what_nobody_saw_is_marked(tree: xr.DataTree, tmp_path: Path) -> None:
    told = {"markers": ["skull", "crown"], "coordinates": ["head.Z", "head.Y", "head.X"]}
    hidden = tree.copy()
    hidden.attrs["unseen"] = json.dumps(told)
    export(hidden, tmp_path, "walk", ("trc", "mot", "c3d", "csv"))
    for end in ("", "_lower", "_upper"):
        names = read_trc(tmp_path / f"walk{end}.trc").names
        assert len(names) == 15 and not set(told["markers"]) & set(names)
    text = (tmp_path / "walk.mot").read_text()
    assert not set(told["coordinates"]) & set(read_mot(tmp_path / "walk.mot").columns)
    assert "No camera saw head.Y, which is left out." in text
    residuals = load_ezc3d().c3d(str(tmp_path / "walk.c3d"))["data"]["meta_points"]["residuals"][0]
    names = full_body().tree.marker_names
    assert [name for name, own in zip(names, residuals, strict=True) if (own < 0).all()] == told["markers"]
    with (tmp_path / "walk.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert {row["joint"] for row in rows if row["seen"] == "0"} == {"skull", "crown", "head"}
    assert len(rows) == 4 * (17 * 3 + 29)
    hidden.attrs["unseen"] = json.dumps(["crown"])
    with pytest.raises(InputError, match="unseen: the result's list of unseen joints is none"):
        export(hidden, tmp_path, "walk", ("trc",))


def test_other_levels(tree: xr.DataTree, tmp_path: Path) -> None:
    export(tree, tmp_path, "half", ("trc",), level=0.6)
    draws = tree["posterior/markers"].values[0]
    lower = np.loadtxt(tmp_path / "half_lower.trc", skiprows=6)[:, 2]
    np.testing.assert_allclose(lower, np.quantile(draws[:, :, 0, 0], 0.2, axis=0), atol=1e-3)
    with pytest.raises(InputError, match="level: 1.5"):
        export(tree, tmp_path, "half", level=1.5)
    with pytest.raises(InputError, match="'fbx' .expected trc, mot, osim, bvh, c3d, csv"):
        export(tree, tmp_path, "half", ("fbx",))


@pytest.mark.full
def test_clamped_joints_have_no_width(tmp_path: Path) -> None:
    coordinates, angles = angle_estimates(result("arm"))
    width = dict(zip([each.name for each in coordinates], (angles.upper - angles.lower).max(0), strict=True))
    assert width["elbow_flex_r"] > 5.0 and width["knee_angle_r"] < 1e-3 and width["elbow_flex_l"] < 1e-3


@pytest.mark.full
def test_a_rate_that_nobody_said(tree: xr.DataTree) -> None:
    unknown = clock_of(result(rate=None))
    assert unknown.assumed and unknown.rate == 30.0
    np.testing.assert_allclose(unknown.times, FRAMES / 90.0)
    assert not clock_of(tree).assumed


@pytest.mark.full
def test_a_model_that_is_not_installed_is_not_run(tree: xr.DataTree, tmp_path: Path) -> None:
    other = tree.copy()
    other.attrs = {**tree.attrs, "model": json.dumps("somebody.elses:body")}
    with pytest.raises(InputError, match="which is not installed"):
        export(other, tmp_path, "walk", ("mot",))
    assert len(export(other, tmp_path, "walk", ("trc",))) == 3


@pytest.mark.full
def test_a_result_without_joints(tmp_path: Path) -> None:
    bare = build_result(state=np.zeros((1, 5, 3, 1)), names=Names(("level",)))
    with pytest.raises(InputError, match="no joints in space"):
        export(bare, tmp_path, "walk")


def test_a_motion_file_that_tells_no_unit_is_in_radians(tmp_path: Path) -> None:
    """As OpenSim takes it."""
    text = "Coordinates\nversion=1\n{}endheader\ntime\tknee\n0\t0.5\n0.1\t0.6\n"
    for header, degrees in (("", False), ("inDegrees=yes\n", True), ("inDegrees=no\n", False)):
        (tmp_path / "walk.mot").write_text(text.format(header))
        found = read_mot(tmp_path / "walk.mot")
        assert found.in_degrees is degrees
        np.testing.assert_array_equal(found.columns["knee"], [0.5, 0.6])
        np.testing.assert_array_equal(found.times, [0.0, 0.1])


def test_places_of_the_pelvis_have_the_spread_of_its_draws() -> None:
    """Five draws of the root's three coordinates, in m along OpenSim's axes; a standard deviation of few is Bessel's."""
    rest = np.asarray(full_body().rest)
    tree = drawn_result(np.tile(rest, (2, 1)), np.where(np.arange(len(rest)) < 3, 12.0, 0.0), np.arange(2), 30.0, num_draws=5)
    coordinates, found = angle_estimates(tree)
    along = [index for index, each in enumerate(coordinates) if each.unit != "degrees"]
    draws = tree["unconstrained_posterior"]["state"].values[0, :, :, :3] / 1000.0
    np.testing.assert_allclose(np.sort(found.spread[:, along], 1), np.sort(draws.std(0, ddof=1), 1), rtol=1e-3)
    widths = np.quantile(draws, 0.95, axis=0) - np.quantile(draws, 0.05, axis=0)
    np.testing.assert_allclose(np.sort((found.upper - found.lower)[:, along], 1), np.sort(widths, 1), rtol=1e-3)
