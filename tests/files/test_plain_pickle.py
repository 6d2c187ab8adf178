"""Pickles of plain values are read; of others, nothing is run."""

from __future__ import annotations

import os
import pickle
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from damage import damaged_copies

from poseppl.errors import InputError, Location
from poseppl.files.plain_pickle import plain_of_pickle

AT = Location("camera.pickle")
CAMERA = {
    "distortion": np.array([[0.1, -0.2, 0.0, 0.0, 0.05]]),
    "intrinsicMat": np.asfortranarray(np.arange(9.0).reshape(3, 3)),
    "imageSize": np.array([[1280], [720]]),
    "small": np.float64(2.5),
    "big": np.arange(3, dtype=">f4"),
    "text": ("a", b"b", None, True, 3),
    "empty": np.zeros((0, 2)),
}


@pytest.mark.parametrize("protocol", range(6))
def test_plain_values_come_back(protocol: int) -> None:
    found = plain_of_pickle(pickle.dumps(CAMERA, protocol), AT)
    assert list(found) == list(CAMERA) and found["text"] == CAMERA["text"] and found["small"] == 2.5
    for name, value in CAMERA.items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(found[name], value)
            assert found[name].shape == value.shape


@pytest.mark.parametrize("name", [b"numpy\ndtype", b"_codecs\nencode", b"numpy.core.multiarray\nscalar"])
def test_nothing_that_a_name_stands_for_is_changed(name: bytes) -> None:
    # BUILD with a pair of states sets attributes, array = 1 here, unless what it is given takes states itself
    program = b"c" + name + b"\nN}X\x05\x00\x00\x00arrayK\x01s\x86b."
    with pytest.raises(InputError, match="a state for a name"):
        plain_of_pickle(program, AT)


class Calls:
    """A pickle that calls a function."""

    def __init__(self, function: Any, *arguments: Any) -> None:
        self.call = (function, arguments)

    def __reduce__(self) -> Any:
        return self.call


@pytest.mark.parametrize("protocol", range(6))
def test_nothing_is_called(tmp_path: Path, protocol: int) -> None:
    target = tmp_path / "called"
    for evil in (Calls(os.system, f"touch {target}"), Calls(eval, "1"), Calls(np.load, "x"), Calls(getattr, "", "join")):
        with pytest.raises(InputError, match=r"camera\.pickle: the pickle asks for"):
            plain_of_pickle(pickle.dumps({"rotation": evil}, protocol), AT)
    assert not target.exists()


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (OrderedDict(a=1), "asks for collections.OrderedDict"),
        (np.array([print], object), "asks for|an array of 'O8'"),
        (np.array([{}], object), "an array of 'O8'"),
        (np.array(["2020-01-01"], "M8[D]"), "an array of 'M8'"),
        (np.zeros(2, [("a", "f8")]), "an array of 'V8'"),
        ({1, 2}, "not a plain value|asks for"),
        (1j, "asks for builtins.complex"),
        (np.ones, "asks for numpy"),
    ],
)
def test_other_values_are_refused(value: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        plain_of_pickle(pickle.dumps(value), AT)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x80\x04.",
        b"I1\n",
        b"\x80\x02]r\xff\xff\xff\x7f.",  # a place far out in the table of what was put aside
        b"\x80\x02cnumpy\nndarray\n.",
        b"\x80\x02cnumpy\ndtype\n.",
        b"\x80\x03cnumpy._core.multiarray\nscalar\nK\x01K\x02\x86R.",
        b"\x80\x03cnumpy.core.multiarray\n_reconstruct\n)R(K\x01K\x02tb.",
        b"\x80\x02P0\n.",
        b"\x80\x02]q\x00h\x00a.",  # a list that holds itself
        b"]" + b"q\x00h\x00h\x00h\x00\x87" * 200 + b".",  # 3^200 values in 1 kB
    ],
)
def test_malformed_pickles_end_in_one_error(data: bytes) -> None:
    with pytest.raises(InputError, match=r"camera\.pickle"):
        plain_of_pickle(data, AT)


@pytest.mark.full
@pytest.mark.parametrize("protocol", [2, 4, 5])
def test_damaged_pickles_end_in_a_value_or_one_error(protocol: int) -> None:
    refused = 0
    for copy in damaged_copies(pickle.dumps(CAMERA, protocol), 300):
        try:
            plain_of_pickle(copy, AT)
        except InputError:
            refused += 1
    assert refused > 150
