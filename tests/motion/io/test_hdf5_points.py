"""Points in HDF5: DeepLabCut's tables as pandas wrote them, SLEAP's analysis, and wrong, damaged or malicious files."""

from __future__ import annotations

import gzip
import json
import pickle
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
from damage import damaged_copies

from poseppl.errors import InputError
from poseppl.motion.io.deeplabcut import read_deeplabcut_csv, read_deeplabcut_h5
from poseppl.motion.io.detector_arrays import read_sleap
from poseppl.motion.io.keypoints import detector_of, read_keypoints

SAMPLES = Path(__file__).parent / "samples"
FORMS = ["one_table", "one_fixed", "several_table", "several_fixed"]


def unpacked(tmp_path: Path, form: str) -> Path:
    path = tmp_path / f"{form}.h5"
    path.write_bytes(gzip.decompress((SAMPLES / f"dlc_{form}.h5.gz").read_bytes()))
    return path


@pytest.mark.parametrize("form", FORMS)
def test_a_table_of_pandas_is_the_same_as_its_csv(tmp_path: Path, form: str) -> None:
    path = unpacked(tmp_path, form)
    found, expected = read_deeplabcut_h5(path), read_deeplabcut_csv(SAMPLES / f"dlc_{form}.csv")
    assert detector_of(path) == "deeplabcut" and found.names == expected.names == ("knee", "foot")
    assert found.individuals == expected.individuals == (() if form.startswith("one") else ("mouse1", "mouse2"))
    np.testing.assert_array_equal(found.points, expected.points)
    np.testing.assert_array_equal(found.confidence, expected.confidence)
    assert np.isnan(found.points[2, 0, 0]).all() and found.confidence[2, 0, 0] == 0  # beside a likelihood of 1


def test_names_of_columns_call_nothing(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self):  # type: ignore[no-untyped-def]
            return (Path.touch, (tmp_path / "called",))

    path = unpacked(tmp_path, "one_table")
    with h5py.File(path, "r+") as file:
        file["df_with_missing/table"].attrs["values_block_0_kind"] = np.bytes_(pickle.dumps([Evil()], 0))
    with pytest.raises(InputError, match=r"one_table\.h5, values_block_0_kind: the pickle asks for"):
        read_deeplabcut_h5(path)
    assert not (tmp_path / "called").exists()


@pytest.mark.parametrize(
    ("form", "name", "words"),
    [("one_table", "df_with_missing/table", "table: it is missing"), ("one_fixed", "df_with_missing/block0_values", "missing")],
)
def test_links_and_absent_parts_are_refused(tmp_path: Path, form: str, name: str, words: str) -> None:
    path = unpacked(tmp_path, form)
    with h5py.File(path, "r+") as file:
        del file[name]
        file[name] = h5py.ExternalLink("/etc/passwd", "/")
    with pytest.raises(InputError, match="a link|columns of several kinds"):
        read_deeplabcut_h5(path)


def test_what_a_file_declares_is_bounded(tmp_path: Path) -> None:
    path = unpacked(tmp_path, "one_fixed")
    with h5py.File(path, "r+") as file:
        del file["df_with_missing/block0_values"]
        file.create_dataset("df_with_missing/block0_values", (10**6, 10**6), "f8", chunks=(1000, 1000), compression="gzip")
    with pytest.raises(InputError, match=r"block0_values: it declares .* MiB"):
        read_deeplabcut_h5(path)


def sleap(path: Path, tracks: int = 2, standard: bool = False, scores: bool = True) -> np.ndarray:
    """A file of random tracks; returned are these as (frames, tracks, nodes, 3)."""
    table = np.random.default_rng(0).uniform(1, 100, (5, tracks, 3, 3))
    table[1, 0, 2, :2] = np.nan
    names = ["frame", "track", "node"] if standard else ["track", "node", "frame"]
    order = [0, 1, 2] if standard else [1, 2, 0]
    with h5py.File(path, "w") as file:
        file["node_names"] = np.array(["head", "thorax", "abdomen"], "S")
        file["track_names"] = np.array([f"track_{number}" for number in range(tracks)], "S")
        points = table[..., :2] if standard else table[..., :2].transpose(1, 3, 2, 0)
        file.create_dataset("tracks", data=points, compression="gzip")
        if scores:
            file["point_scores"] = table[..., 2].transpose(order)
        if standard:
            file["tracks"].attrs["dims"] = json.dumps(["frame", "track", "node", "xy"])
            file["point_scores"].attrs["dims"] = json.dumps(names)
    return table


@pytest.mark.parametrize("standard", [False, True])
def test_sleap(tmp_path: Path, standard: bool) -> None:
    table = sleap(tmp_path / "a.h5", standard=standard)
    found = read_sleap(tmp_path / "a.h5")
    assert detector_of(tmp_path / "a.h5") == "sleap"
    assert found.names == ("head", "thorax", "abdomen") and found.individuals == ("track_0", "track_1")
    np.testing.assert_array_equal(found.points, table[..., :2])
    assert found.confidence[1, 0, 2] == 0 and found.confidence[0, 0, 2] == table[0, 0, 2, 2]
    sleap(tmp_path / "b.h5", scores=False)
    assert set(np.unique(read_sleap(tmp_path / "b.h5").confidence)) == {0.0, 1.0}


def test_animals_that_were_put_right_by_hand_have_no_score_and_are_certain(tmp_path: Path) -> None:
    table = sleap(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["point_scores"][0, :, 3] = np.nan
    found = read_sleap(tmp_path / "a.h5")
    np.testing.assert_array_equal(found.points, table[..., :2])
    np.testing.assert_array_equal(found.confidence[3, 0], 1.0)
    assert found.confidence[1, 0, 2] == 0


def test_a_wrong_sleap_file_is_refused(tmp_path: Path) -> None:
    for change, words in (
        (lambda file: file.__delitem__("node_names"), "node_names: it is missing"),
        (lambda file: file["tracks"].attrs.__setitem__("dims", '["a", "b", "c", "d"]'), "dims: axes"),
        (lambda file: file["tracks"].attrs.__setitem__("dims", "{"), "dims: no names of axes"),
        (lambda file: (file.__delitem__("tracks"), file.__setitem__("tracks", np.zeros((2, 2, 4, 5)))), "tracks: shape"),
        (lambda file: (file.__delitem__("tracks"), file.__setitem__("tracks", np.zeros(5))), "tracks: values of type"),
        (lambda file: (file.__delitem__("point_scores"), file.__setitem__("point_scores", np.ones((1, 1, 1)))), "point_scores"),
    ):
        sleap(tmp_path / "wrong.h5")
        with h5py.File(tmp_path / "wrong.h5", "r+") as file:
            change(file)
        with pytest.raises(InputError, match=rf"wrong\.h5.*{words}"):
            read_sleap(tmp_path / "wrong.h5")


def files(tmp_path: Path) -> Iterator[bytes]:
    for form in FORMS:
        yield unpacked(tmp_path, form).read_bytes()
    sleap(tmp_path / "sleap.h5")
    yield (tmp_path / "sleap.h5").read_bytes()


def test_a_damaged_file_is_read_or_refused(tmp_path: Path) -> None:
    refused = 0
    for data in files(tmp_path):
        for copy in damaged_copies(data, 40):
            (tmp_path / "damaged.h5").write_bytes(copy)
            try:
                found = read_keypoints(tmp_path / "damaged.h5", "sleap" if b"node_names" in data else "deeplabcut")
            except InputError as error:
                refused += 1
                assert "damaged.h5" in str(error)
            else:
                assert not np.isinf(found.points).any() and np.isfinite(found.confidence).all()
    assert refused > 40
