"""Small files that would take hours or gigabytes to read: written to a folder, read, and measured.

    python tests/files/bombs.py FOLDER

prints, as JSON, what each brings about by name: processor seconds, MiB of memory beyond that of the process, and the message.
"""

from __future__ import annotations

import json
import resource
import struct
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from poseppl.errors import InputError, Location
from poseppl.files.bounded_reading import read_json, read_toml, read_xml
from poseppl.files.csv_fields import rows_of_csv
from poseppl.files.hdf5_reading import array, open_hdf5
from poseppl.files.store import Store
from poseppl.motion.io.cameras import read_opencap_camera
from poseppl.motion.io.cameras_yaml import read_opencv_yaml
from poseppl.motion.io.deeplabcut import read_deeplabcut_h5
from poseppl.motion.io.detector_tables import read_caliscope_points
from poseppl.motion.io.opencv import read_image

RECORD = {"version": 1}
_DOUBLED = b")" + b"2\x86" * 60
"""Bomb of a pickle: a tuple of two tuples of two tuples ..., 2^60 in all."""
_HASHED = b"\x80\x02}" + _DOUBLED + b"K\x01s."
_TEXT = b"X" + struct.pack("<I", 100_000) + b"a" * 100_000
_COPIED = b"\x80\x03]c_codecs\nencode\nq\0" + _TEXT + b"X\6\0\0\0latin1\x86q\x0100(" + b"h\0h\1R" * 5_000 + b"e."
_WRITTEN = b"\x80\x02]cnumpy\ndtype\n" + _DOUBLED + b"\x85Ra."
_SPARSE = b"sync_index,cam_id,object_id,keypoint_id,img_loc_x,img_loc_y\n"
_SPARSE += b"".join(b"%d,0,99,999,1,1\n" % t for t in range(9999))
_YAML_LINE = b"1234567.123456123456123456123456123456,\n"


def _deeplabcut(path: Path) -> None:
    with h5py.File(path, "w") as file:
        group = file.create_group("tracks")
        group.attrs["pandas_type"] = "frame_table"
        rows = group.create_dataset("table", data=np.zeros(1, [("index", "i8"), ("values_block_0", "f8", (3,))]))
        rows.attrs["values_block_0_kind"] = np.bytes_(_HASHED)


def _large_chunk(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("a", (1,), "f8", maxshape=(None,), chunks=(2**27,), compression="gzip")


def _fill(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("a", (2**26,), "f8", chunks=(2**16,), compression="gzip")
        file["b"] = np.frombuffer(np.random.default_rng(0).bytes(2**20), "u1")


def _store(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        with archive.open("__record__.npy", "w") as stream:
            np.save(stream, np.frombuffer(json.dumps(RECORD).encode(), np.uint8))
        with archive.open("a.npy", "w") as stream:
            np.lib.format.write_array_header_2_0(stream, {"descr": "|u1", "fortran_order": False, "shape": (2**28,)})
            for _ in range(2**4):
                stream.write(bytes(2**24))


def _read_store(path: Path) -> None:
    def note(message: str) -> None:
        raise InputError(message)

    Store(path.parent, "results", note).load(path.stem, RECORD)


def _read_array(path: Path) -> None:
    with open_hdf5(path, "points") as file:
        array(file, "a", Location(path))


def _read_xml(path: Path) -> Any:
    return read_xml(path, "a calibration")


BOMBS: dict[str, tuple[Any, Callable[[Path], Any]]] = {
    "hash.pickle": (_HASHED, read_opencap_camera),
    "copies.pickle": (_COPIED, read_opencap_camera),
    "kind.pickle": (_WRITTEN, read_opencap_camera),
    "recursion.pickle": (b"\x80\x02" + b"]" * 150_000 + b"a" * 149_999 + b".", read_opencap_camera),
    "deeplabcut.h5": (_deeplabcut, read_deeplabcut_h5),
    "chunk.h5": (_large_chunk, _read_array),
    "fill.h5": (_fill, _read_array),
    "key.toml": (b".".join([b"a"] * 500_000) + b" = 1", read_toml),
    "quoted.toml": (b'"\\"".' * 200_000 + b"a = 1", read_toml),
    "list.yml": (b"%YAML:1.0\n---\na: [\n" + _YAML_LINE * 99_000 + b"1. ]\n", read_opencv_yaml),
    "spaces.yml": (b"%YAML:1.0\n---\na" + b" " * 4_000_000 + b"b\n", read_opencv_yaml),
    "points.csv": (_SPARSE, read_caliscope_points),
    "lists.json": (b"[" + b"[]," * 3_000_000 + b"[]]", read_json),
    "levels.json": (b"[" * 10**6, read_json),
    "columns.csv": (b"," * 10**7, lambda path: list(rows_of_csv(path))),
    "laughs.xml": (b'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">]><a>&a;</a>', _read_xml),
    "elements.xml": (b"<a>" * 10**6, _read_xml),
    "names.xml": (
        b"<a xmlns='" + b"x" * 10**6 + b"'>" + b"<b/>" * 50_000 + b"</a>",
        _read_xml,
    ),
    "store.npz": (_store, _read_store),
    "chunk.png": (b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 2**31 - 2**24) + b"IDAT" + bytes(1000), read_image),
}


def _measure(path: Path, read: Callable[[Path], Any]) -> tuple[float, float, str]:
    before, start = _peak(), time.process_time()
    try:
        message = f"read {len(read(path))}"
    except InputError as error:
        message = str(error)
    return time.process_time() - start, _peak() - before, message


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
    resource.setrlimit(resource.RLIMIT_DATA, (2**32, 2**32))
    found = {}
    for name, (content, read) in BOMBS.items():
        path = Path(sys.argv[1], name)
        if callable(content):
            content(path)
        else:
            path.write_bytes(content)
        found[name] = _measure(path, read)
    print(json.dumps(found))
