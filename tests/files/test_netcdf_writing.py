"""A disk that fills up while a result is written."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from poseppl.files.netcdf import write_netcdf

pytestmark = pytest.mark.full

SCRIPT = """
import resource, sys
import numpy as np, xarray as xr
from poseppl.errors import PosepplError
from poseppl.runs.results import Names, build_result, save_result
tree = build_result(state=np.random.default_rng(0).standard_normal((1, 200, 40, 20)), names=Names([f"x{i}" for i in range(20)]))
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    save_result(tree, sys.argv[1])
except PosepplError as error:
    print(error)
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
save_result(tree, sys.argv[1])
"""


@pytest.mark.parametrize("room", [1000, 500_000])
def test_a_disk_that_fills_up_costs_neither_the_process_nor_the_result(tmp_path: Path, room: int) -> None:
    """Files that may not grow are what a full disk is to a writer; the system lets anybody have them."""
    target = tmp_path / "run.nc"
    done = subprocess.run([sys.executable, "-c", SCRIPT, str(target), str(room)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "run.nc: the disk is full" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["run.nc"]
    with xr.open_datatree(target, engine="h5netcdf") as tree:
        assert tree["unconstrained_posterior/state"].shape == (1, 200, 40, 20)


def test_what_is_written_is_what_is_read(tmp_path: Path) -> None:
    tree = xr.DataTree.from_dict({"a": xr.Dataset({"x": ("t", np.arange(3.0))}), "b": xr.Dataset({"name": ("k", ["é", "b"])})})
    write_netcdf(tree, tmp_path / "a.nc", {"/a": {"x": {"zlib": True}}})
    with xr.open_datatree(tmp_path / "a.nc", engine="h5netcdf") as read:
        assert read["a"].dataset.equals(tree["a"].dataset) and read["b/name"].values.tolist() == ["é", "b"]
