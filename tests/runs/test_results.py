from __future__ import annotations

from pathlib import Path

import arviz_stats
import h5py
import numpy as np
import pytest
import xarray as xr
from synthetic import synthetic_result

from poseppl.errors import InputError
from poseppl.runs.contents import FLAT
from poseppl.runs.results import Names, build_result, is_weighted, load_result, provenance, save_result


def test_groups_and_named_coordinates() -> None:
    tree = synthetic_result(num_frames=3)
    assert set(tree.children) == {"posterior", FLAT, "sample_stats", "summary", "observed_data", "truth", "camera", "body"}
    assert tree["unconstrained_posterior/state"].dims == ("chain", "draw", "frame", "state_dim")
    assert tree["posterior/points"].dims == ("chain", "draw", "frame", "camera", "marker", "xy")
    assert tree["summary/markers_quantile"].dims == ("frame", "quantile", "marker", "axis")
    assert list(tree["truth/markers"].coords["frame"].values) == [10, 11, 12]
    assert float(tree["posterior/markers"].sel(marker="head", axis="z").mean()) > 1500


def test_summary_from_draws_equals_numpy_and_given_summary_is_kept() -> None:
    tree = synthetic_result(num_frames=3)
    pooled = tree["unconstrained_posterior/state"].values.reshape(-1, *tree["unconstrained_posterior/state"].shape[2:])
    np.testing.assert_allclose(tree["summary/state_mean"], pooled.mean(axis=0), rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(tree["summary/state_sd"], pooled.std(axis=0, ddof=1), rtol=1e-5)
    np.testing.assert_allclose(tree["summary/state_quantile"].sel(quantile=0.1), np.quantile(pooled, 0.1, axis=0), rtol=1e-5)
    given = {"state_mean": np.full((3, 1), 7.0)}
    other = build_result(state=np.zeros((1, 2, 3, 1)), names=Names(("level",)), summary=given)
    assert float(other["summary/state_mean"].min()) == 7.0


def test_arviz_takes_the_tree_as_it_is() -> None:
    tree = synthetic_result(num_frames=3)
    table = arviz_stats.summary(tree, var_names=["state"])
    assert len(table) == tree["posterior"].sizes["frame"] * tree["unconstrained_posterior"].sizes["state_dim"]
    assert arviz_stats.ess(tree, var_names=["state"], method="mean")["state"].dims == ("frame", "state_dim")
    assert float(arviz_stats.rhat(tree, var_names=["state"])["state"].max()) < 1.2


@pytest.mark.full
@pytest.mark.parametrize("weighted", [False, True])
def test_round_trip_keeps_everything(tmp_path: Path, weighted: bool) -> None:
    tree = synthetic_result(weighted=weighted)
    save_result(tree, tmp_path / "result.nc")
    again = load_result(tmp_path / "result.nc")
    assert again.identical(tree)
    assert again["unconstrained_posterior/state"].dtype == np.float32
    assert is_weighted(again) == weighted
    assert provenance(again)["settings"]["note"] == "<b>not bold</b>"
    assert provenance(again)["wall_seconds"] == 2.5
    assert [path.name for path in tmp_path.iterdir()] == ["result.nc"]


def test_results_are_compressed(tmp_path: Path) -> None:
    tree = build_result(state=np.zeros((10, 100, 100, 5), np.float32), names=Names(tuple("abcde")))
    save_result(tree, tmp_path / "result.nc")
    assert (tmp_path / "result.nc").stat().st_size < tree["unconstrained_posterior/state"].nbytes / 10


def test_random_numbers_are_not_packed(tmp_path: Path) -> None:
    draws = np.random.default_rng(0).normal(size=(1, 200, 30, 2)).astype(np.float32)
    save_result(build_result(state=draws, names=Names(("a", "b"))), tmp_path / "result.nc")
    with h5py.File(tmp_path / "result.nc") as file:
        state, mean = file["unconstrained_posterior/state"], file["summary/state_mean"]
        assert state.compression is None and np.array_equal(state, draws) and mean.shape == (30, 2)


@pytest.mark.full
def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "result.nc"
    save_result(synthetic_result(num_frames=2), path)
    before = path.read_bytes()
    broken = synthetic_result(num_frames=2)
    broken.attrs["bad"] = object()
    with pytest.raises(TypeError):
        save_result(broken, path)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["result.nc"]


def _truncated(path: Path) -> None:
    save_result(synthetic_result(num_frames=2), path)
    path.write_bytes(path.read_bytes()[:5000])


def _foreign(path: Path) -> None:
    xr.Dataset({"a": ("t", [1.0])}).to_netcdf(path, engine="h5netcdf")


def _newer(path: Path) -> None:
    tree = synthetic_result(num_frames=2)
    tree.attrs["poseppl_result"] = 99
    save_result(tree, path)


@pytest.mark.full
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: None, "no such file"),
        (lambda path: path.write_bytes(b""), "empty"),
        (lambda path: path.write_text("hello"), "not an HDF5 or NetCDF file"),
        (_truncated, "damaged"),
        (_foreign, "not a result of poseppl"),
        (_newer, "layout 99"),
    ],
)
def test_unreadable_files_are_named_in_one_message(tmp_path: Path, make, message: str) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "result.nc"
    make(path)
    with pytest.raises(InputError, match=message) as caught:
        load_result(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"state": np.zeros((2, 3, 4))}, r"expected \(chain, draw, frame, state_dim\)"),
        ({"state": np.zeros((1, 2, 3, 2))}, "state has shape"),
        ({"state": np.zeros((1, 2, 3, 1)), "sample_stats": {"ess": np.zeros(4)}}, "ess has shape"),
        ({"state": np.zeros((1, 2, 3, 1)), "summary": {"state_mean": np.zeros((3, 2))}}, "state_mean has shape"),
        ({"state": np.zeros((1, 2, 3, 1)), "attrs": {"rate": 3}}, "reserved"),
    ],
)
def test_wrong_shapes_are_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build_result(names=Names(("level",)), **arguments)  # type: ignore[arg-type]


@pytest.mark.full
def test_extras_of_any_shape_get_dimensions() -> None:
    tree = build_result(state=np.zeros((1, 2, 3, 1)), names=Names(("level",)), extras={"speed": np.zeros((1, 2, 3, 5))})
    assert tree["posterior/speed"].dims == ("chain", "draw", "frame", "speed_dim_0")
