"""Small files that would take hours or gigabytes are refused, or read, at once."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from waiting import PATIENCE

from poseppl.errors import InputError
from poseppl.files.bounded_reading import MAX_KEY_PARTS, read_toml, read_xml
from poseppl.files.numpy_arrays import read_parts
from poseppl.files.table_reading import read_table

MAX_SECONDS, MAX_MIB = 1.0, 200.0
READ = {"list.yml", "names.xml"}
"""Those that are large and sound."""


def test_bombs_are_refused_or_read_in_a_second_and_200_mib(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    script = Path(__file__).with_name("bombs.py")
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path)], check=False, capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    assert len(found) == 20
    for name, (seconds, mib, message) in found.items():
        assert seconds < MAX_SECONDS and mib < MAX_MIB, (name, seconds, mib)
        assert message.startswith("read") == (name in READ), message
        assert len(message) < 400 + len(str(tmp_path))


@pytest.mark.full
def test_a_table_of_parquet_holds_no_more_than_it_says(tmp_path: Path) -> None:
    """Texts of 1 MB by reference, 2,000 times, and lists, are no numbers; 50 million equal numbers take 200 kB."""
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    texts = arrow.DictionaryArray.from_arrays(np.zeros(2000, "i4"), ["a" * 10**6])
    path = tmp_path / "table.parquet"
    parquet.write_table(arrow.table({"t": texts, "x": np.zeros(2000)}), path, store_schema=False)
    before = arrow.total_allocated_bytes()
    table = read_table(path)
    assert arrow.total_allocated_bytes() - before < 10**6
    assert list(table.columns) == ["x"] and str(table.unread["t"]).startswith(f"{path}, t: string")
    parquet.write_table(arrow.table({"x": np.zeros(50_000_000, "i1")}), path)
    with pytest.raises(InputError, match="50000000 numbers"):
        read_table(path)


def test_keys_of_toml_have_few_parts(tmp_path: Path) -> None:
    path = tmp_path / "keys.toml"
    path.write_text("# rig\n[" + ".".join("ab" * (MAX_KEY_PARTS // 2)) + "]\nsize = [1.5, 2.5]\n")
    assert read_toml(path)
    for part in ("a", " a ", "'a.b'", '"a\\"b"'):
        path.write_text("# rig\n" + ".".join([part] * (MAX_KEY_PARTS + 1)) + " = 1\n")
        with pytest.raises(InputError, match=r"keys\.toml, line 2: a key or a text of too many parts"):
            read_toml(path)


def test_xml_is_read_without_its_definitions(tmp_path: Path) -> None:
    path = tmp_path / "rig.xml"
    path.write_text('<?xml version="1.0"?><!-- <!DOCTYPE --><rig><camera n="1">x &lt; 2</camera><camera n="2"/></rig>')
    assert [(each.get("n"), each.text) for each in read_xml(path, "a rig").iter("camera")] == [("1", "x < 2"), ("2", None)]
    for text in ("<rig>", "<rig></camera>", "", "rig", '<!DOCTYPE rig SYSTEM "file:///etc/passwd"><rig/>'):
        path.write_text(text or " ")
        with pytest.raises(InputError, match="a rig"):
            read_xml(path, "a rig")


def test_parts_of_npz_files_are_as_large_as_they_declare(tmp_path: Path) -> None:
    path = tmp_path / "arrays.npz"
    np.savez(path, a=np.arange(5), b=np.array("text"))
    with zipfile.ZipFile(path) as archive:
        found = read_parts(archive, 10_000)
        assert found["a"].tolist() == [0, 1, 2, 3, 4] and str(found["b"]) == "text"
        with pytest.raises(ValueError, match="declares"):
            read_parts(archive, 250)  # each alone has less
    np.savez(path, a=np.array([{}], object))
    with zipfile.ZipFile(path) as archive, pytest.raises(ValueError, match="does not contain the array that it declares"):
        read_parts(archive, 10_000)
