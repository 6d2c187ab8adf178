"""Files of learned activities: what is written is read, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr
from synthetic_walks import walks

from poseppl.errors import InputError
from poseppl.motion.learned import TrainingSettings, read_motion_model, train_motion_model, write_motion_model


@dataclass
class Written:
    model: object
    path: object


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    model = train_motion_model(walks(), "walks", TrainingSettings(num_components=2, num_states=5, num_rounds=3))
    path = tmp_path_factory.mktemp("models") / "walk.nc"
    write_motion_model(model, path)
    return Written(model, path)


@pytest.mark.full
def test_a_file_holds_the_model(written):
    again = read_motion_model(written.path)
    for name, value in written.model._asdict().items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(getattr(again, name), value)
    assert again.coordinates == written.model.coordinates and again.persons == ("tall", "small") and again.rate == 60.0
    assert again.provenance["files"] == ["tall.bvh", "small.bvh"] and again.provenance["frames"] == [200, 200]
    assert "hmmlearn" in again.provenance["versions"] and again.provenance["settings"]["num_states"] == 5


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("transition", lambda a: a + 0.1, "transition.*sum to one"),
        ("initial", lambda a: a * np.array([-1, 3, 1, 1, 1]), "initial.*sum to one"),
        ("covariances", lambda a: -a, "covariances.*positive"),
        ("components", lambda a: 2 * a, "components.*orthonormal"),
        ("means", lambda a: a * np.nan, "means.*finite"),
        ("learned", lambda a: a + 100, "learned.*indices"),
        ("limits", lambda a: a[:, ::-1], "limits.*least"),
    ],
)
def test_what_is_no_model_is_refused(written, tmp_path, name, change, words):
    path = tmp_path / "walk.nc"
    write_motion_model(written.model._replace(**{name: change(getattr(written.model, name))}), path)
    with pytest.raises(InputError, match=words):
        read_motion_model(path)


@pytest.mark.full
def test_other_files_are_refused(written, tmp_path):
    path = tmp_path / "walk.nc"
    path.write_bytes(written.path.read_bytes()[:-200])
    with pytest.raises(InputError, match="damaged"):
        read_motion_model(path)
    xr.Dataset({"x": ("t", np.zeros(3))}).to_netcdf(path, engine="h5netcdf")
    with pytest.raises(InputError, match="no learned motion.*fit-motion"):
        read_motion_model(path)
    whole = xr.open_dataset(written.path, engine="h5netcdf").load()
    for lacking, words in (("means", "means: it is missing"), ("person", "its content is unknown")):
        whole.drop_vars(lacking).to_netcdf(path, engine="h5netcdf")
        with pytest.raises(InputError, match=words):
            read_motion_model(path)
    whole.assign_attrs(poseppl_motion_model=99).to_netcdf(path, engine="h5netcdf")
    with pytest.raises(InputError, match="layout 99"):
        read_motion_model(path)
