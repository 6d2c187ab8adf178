"""Trees of xarray's shortcuts against those of its public constructors."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from poseppl.runs import datasets
from poseppl.runs.labels import Names, coordinates

KNOWN = xr.Coordinates({"draw": np.arange(2), "frame": np.array([3, 5, 9]), "state_dim": np.array(["x", "y"])})
VARIABLES = {
    "state": xr.Variable(("draw", "frame", "state_dim"), np.arange(12.0).reshape(2, 3, 2)),
    "other": xr.Variable(("unnamed",), np.ones(4)),
    "scalar": xr.Variable((), np.float32(2.0)),
}


@pytest.fixture(params=[True, False], ids=["shortcuts", "public"])
def either(request, monkeypatch):
    assert datasets._shortcuts_agree()
    monkeypatch.setattr(datasets, "_shortcuts_agree", lambda: request.param)


def test_a_tree_is_that_of_the_public_constructors(either):
    group = datasets.dataset_of(VARIABLES, KNOWN)
    used = xr.Coordinates({name: KNOWN[name] for name in ("draw", "frame", "state_dim")})
    assert group.identical(xr.Dataset(VARIABLES, used)) and set(group.xindexes) == set(used)
    assert dict(group.sizes) == {"draw": 2, "frame": 3, "state_dim": 2, "unnamed": 4}
    assert set(datasets.dataset_of({"other": VARIABLES["other"]}, KNOWN).coords) == set()
    tree = datasets.tree_of({"a": group, "b": group[["other"]]}, {"rate": 30.0})
    assert tree.identical(xr.DataTree.from_dict({"/": xr.Dataset(attrs={"rate": 30.0}), "a": group, "b": group[["other"]]}))
    assert tree["a"].parent is tree and tree["a"].path == "/a" and tree.copy(deep=True).identical(tree)
    assert tree["a"].sel(frame=5, state_dim="y")["state"].values.tolist() == [3.0, 9.0]


def test_what_is_changed_in_one_group_stays_there(either):
    groups = {name: datasets.dataset_of(VARIABLES, KNOWN) for name in ("a", "b")}
    tree, later = datasets.tree_of(groups, {}), datasets.tree_of(groups, {})
    tree["a/frame"].attrs["units"] = tree["a/state"].attrs["units"] = "s"
    tree["a"]["new"] = ("frame", np.zeros(3))
    assert tree["a/frame"].attrs and "new" in tree["a"]
    for other in (tree["b"], later["a"]):
        assert not other["frame"].attrs and not other["state"].attrs and "new" not in other


def test_a_variable_with_the_name_of_a_coordinate_is_refused(either):
    with pytest.raises(ValueError):
        datasets.dataset_of({"frame": xr.Variable(("draw", "frame"), np.ones((2, 3)))}, KNOWN)


def test_where_xarray_has_no_shortcuts_the_public_constructors_serve(monkeypatch):
    monkeypatch.delattr(xr.Dataset, "_construct_direct")
    assert not datasets._shortcuts_agree.__wrapped__()


def test_coordinates_that_results_share_cannot_be_written_to():
    first, second = (coordinates(Names(("x",)), (1, 2, 3)) for _ in range(2))
    assert first is second and coordinates(Names(("x",)), (1, 2, 3), [4, 5, 6])["frame"].values.tolist() == [4, 5, 6]
    with pytest.raises(ValueError):
        first["frame"].values[0] = 7
    first["state_dim"].values[0] = "y"
    assert second["state_dim"].values.tolist() == ["x"] and coordinates(Names(()), (1, 2, 0)).sizes["frame"] == 0
