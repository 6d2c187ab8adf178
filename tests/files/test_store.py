from __future__ import annotations

import os

import numpy as np
import pytest
from damage import damaged_copies

from poseppl.errors import InputError
from poseppl.files.store import Store, key_of

ARRAYS = {"mean": np.arange(6.0).reshape(2, 3), "count": np.int32(7), "name": np.array(["a", "bc"])}


@pytest.fixture(params=[False, True], ids=["stored", "compressed"])
def store(tmp_path, request):
    notes = []
    store = Store(tmp_path / "a" / "b", "results", notes.append, compressed=request.param)
    store.notes = notes
    return store


def equal(found):
    assert list(found) == list(ARRAYS)
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(found[name], array, strict=True)


def test_arrays_come_back_to_whom_they_belong(store):
    assert store.load("seven", {"version": 1}) is None
    store.save("seven", ARRAYS, {"version": 1, "seconds": 0.5})
    equal(store.load("seven", {"version": 1}))
    assert not store.notes and os.listdir(store.folder) == ["seven.npz"]
    assert store.load("seven", {"version": 2}) is None and "of another version (1); computed anew" in store.notes.pop()
    with pytest.raises(InputError, match="holds results of another version: 1"):
        store.load("seven", {"version": 2}, owners=["version"])
    equal(store.load("seven", {"version": 1}))


def test_what_cannot_be_restored_is_damaged(store):
    store.save("seven", ARRAYS, {})
    assert store.load("seven", {}, lambda arrays: arrays["absent"], remedy="made again") is None
    assert "damaged" in store.notes[0] and store.notes[0].endswith("; made again")
    assert store.load("seven", {}, lambda arrays: arrays["count"]) == 7


def test_no_damaged_array_is_taken(store):
    store.save("seven", ARRAYS, {"version": 1})
    path = store.folder / "seven.npz"
    refused = 0
    for damaged in damaged_copies(path.read_bytes(), 100):
        path.write_bytes(damaged)
        found = store.load("seven", {"version": 1})
        refused += found is None
        if found is not None:
            equal(found)
    assert refused == len(store.notes) > 80


def test_nothing_is_pickled(store):
    with pytest.raises(ValueError, match="Object arrays cannot be saved"):
        store.save("seven", {"thing": np.array([object()])}, {})
    assert os.listdir(store.folder) == []
    np.savez(store.folder / "seven.npz", thing=np.array([{}], object))
    assert store.load("seven", {}) is None and "damaged" in store.notes[0]


def test_keys_tell_apart_what_differs():
    one = np.arange(4.0)
    arrays = [[], [None], [one], [one, None], [None, one], [one.astype(np.float32)], [one.reshape(2, 2)], [np.zeros(0)]]
    keys = {key_of(record, each) for record in ({}, {"a": 1}, {"a": "1"}) for each in arrays}
    assert len(keys) == 24
    assert key_of({"a": 1, "b": 2}, [one]) == key_of({"b": 2, "a": 1}, [one.copy()])
