from __future__ import annotations

import errno
import os
import subprocess
import sys

import pytest

from poseppl.errors import InputError, PosepplError
from poseppl.files.atomic_writing import atomic_path, remove_strays
from poseppl.files.bounded_reading import read_text


def test_the_file_appears_when_it_is_whole(tmp_path):
    target = tmp_path / "out.txt"
    with atomic_path(target) as temporary:
        temporary.write_text("new")
        assert temporary.parent == tmp_path and temporary.suffix == ".txt" and not target.exists()
    assert target.read_text() == "new" and os.listdir(tmp_path) == ["out.txt"]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, RuntimeError, SystemExit])
def test_a_stopped_writer_leaves_the_old_file(tmp_path, stop):
    target = tmp_path / "out.txt"
    target.write_text("old")
    with pytest.raises(stop), atomic_path(target) as temporary:
        temporary.write_text("half")
        raise stop
    assert target.read_text() == "old" and os.listdir(tmp_path) == ["out.txt"]


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "full"), OSError("write failed: errno = 28, no room")])
def test_a_full_disk(tmp_path, error):
    with pytest.raises(PosepplError, match="the disk is full"), atomic_path(tmp_path / "out.txt") as temporary:
        temporary.write_text("half")
        raise error
    assert os.listdir(tmp_path) == []


def test_a_full_disk_when_flushing(tmp_path, monkeypatch):
    def fail(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(PosepplError, match="the disk is full"), atomic_path(tmp_path / "out.txt") as temporary:
        temporary.write_text("half")
    assert os.listdir(tmp_path) == []


def test_outputs_that_cannot_be_written(tmp_path, monkeypatch):
    source = tmp_path / "in.txt"
    source.write_text("input")
    (tmp_path / "link.txt").symlink_to(source)
    cases = [
        (tmp_path / "missing" / "out.txt", "the output folder does not exist"),
        (source / "out.txt", "the output"),
        (tmp_path, "the output is a folder"),
        ("/dev/null", "not a regular file"),
        (source, "would overwrite an input"),
        (tmp_path / "link.txt", "would overwrite an input"),
        (tmp_path / ("x" * 300), "cannot be written"),
        ("a\0b", "cannot be written"),
    ]
    for target, message in cases:
        with pytest.raises(InputError, match=message), atomic_path(target, inputs=[source]) as temporary:
            temporary.write_text("new")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(InputError, match="the output folder cannot be written"), atomic_path(tmp_path / "out.txt"):
        pass
    assert source.read_text() == "input" and sorted(os.listdir(tmp_path)) == ["in.txt", "link.txt"]


def test_a_link_is_followed(tmp_path):
    (tmp_path / "link.txt").symlink_to(tmp_path / "real.txt")
    with atomic_path(tmp_path / "link.txt") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "real.txt").read_text() == "new"


def test_a_writer_that_wrote_nothing(tmp_path):
    with pytest.raises(PosepplError, match="nothing was written"), atomic_path(tmp_path / "out.txt"):
        pass


def test_texts(tmp_path):
    path = tmp_path / "in.txt"
    path.write_bytes(b"\xef\xbb\xbfa\r\nb\rc")
    assert read_text(path) == "a\nb\nc"
    path.write_bytes(b"caf\xe9")
    assert read_text(path) == "caf\u00e9"
    for data, message in ((b"", "empty"), (b"a\0", "binary")):
        path.write_bytes(data)
        with pytest.raises(InputError, match=message):
            read_text(path)
    path.write_bytes(b"long")
    with pytest.raises(InputError, match="MiB"):
        read_text(path, max_bytes=3)
    for missing, message in ((tmp_path / "no", "no such file"), (tmp_path, "not a file"), ("a\0b", "cannot|no such")):
        with pytest.raises(InputError, match=message):
            read_text(missing)


@pytest.mark.full
def test_what_killed_writers_left_is_removed_and_nothing_else(tmp_path):
    kill = "import os, sys; from poseppl.files.atomic_writing import atomic_path\n"
    kill += "with atomic_path(sys.argv[1]): os.kill(os.getpid(), 9)"
    assert subprocess.run([sys.executable, "-c", kill, str(tmp_path / "out[1].txt")], check=False).returncode == -9
    (stray,) = tmp_path.iterdir()
    kept = [tmp_path / name for name in (".out[1].notes.txt", ".other.0123456789ab.tmp.txt", ".out[1].0123456789ab.tmp.csv")]
    for path in kept:
        path.write_text("mine")
    for path in tmp_path.iterdir():
        os.utime(path, (0, 0))
    with atomic_path(tmp_path / "out[1].txt") as living:
        living.write_text("new")
        os.utime(living, (0, 0))
        assert not stray.exists()
        remove_strays(tmp_path, "out*", ".txt")
        assert living.exists()  # its writer lives, however slow it is
    assert sorted(tmp_path.iterdir()) == sorted([*kept, tmp_path / "out[1].txt"])
