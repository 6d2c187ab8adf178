"""NetCDF files that declare more than they hold, or reach outside of themselves, are refused before anything is read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from damage import damaged_copies
from synthetic import synthetic_result

from poseppl.cli import main
from poseppl.errors import InputError, PosepplError
from poseppl.files.netcdf import MAX_GROUPS, check_netcdf
from poseppl.runs.results import load_result, save_result

Change = Callable[[h5py.File, Path], None]


def huge(file: h5py.File, folder: Path) -> None:
    file["posterior"].create_dataset("more", shape=(3000, 250_000), dtype="f4", chunks=(100, 1000), compression="gzip")


def cycle(file: h5py.File, folder: Path) -> None:
    file["posterior/again"] = file["/"]


def twice(file: h5py.File, folder: Path) -> None:
    file["posterior/again"] = file["posterior/state"]


def wide(file: h5py.File, folder: Path) -> None:
    for number in range(MAX_GROUPS):
        file.create_group(f"group_{number}")


def deep(file: h5py.File, folder: Path) -> None:
    file.create_group("/".join("abcdefghijkl"))


def soft_link(file: h5py.File, folder: Path) -> None:
    file["posterior/link"] = h5py.SoftLink("/posterior/state")


def external_link(file: h5py.File, folder: Path) -> None:
    with h5py.File(folder / "other.h5", "w") as other:
        other["secret"] = np.arange(3)
    file["posterior/link"] = h5py.ExternalLink(str(folder / "other.h5"), "/secret")


def external_data(file: h5py.File, folder: Path) -> None:
    (folder / "raw.bin").write_bytes(b"secret..")
    file["posterior"].create_dataset("raw", shape=(8,), dtype="u1", external=[(str(folder / "raw.bin"), 0, 8)])


def virtual_data(file: h5py.File, folder: Path) -> None:
    layout = h5py.VirtualLayout(shape=(3,), dtype="i8")
    layout[:] = h5py.VirtualSource(str(folder / "other.h5"), "secret", shape=(3,))
    file["posterior"].create_virtual_dataset("virtual", layout)


def texts(file: h5py.File, folder: Path) -> None:
    file["posterior"].create_dataset("texts", data=["x" * 10] * 200_000, dtype=h5py.string_dtype())


def long_texts(file: h5py.File, folder: Path) -> None:
    file["posterior"].create_dataset("texts", data=["x" * 1_000_000] * 3, dtype=h5py.string_dtype())


def ragged(file: h5py.File, folder: Path) -> None:
    file["posterior"].create_dataset("ragged", shape=(4,), dtype=h5py.vlen_dtype(np.float64))


def attributes(file: h5py.File, folder: Path) -> None:
    for number in range(600):
        file["posterior"].attrs[f"a{number}"] = 1


def text_attribute(file: h5py.File, folder: Path) -> None:
    file["posterior"].attrs.create("many", ["x"] * 40, dtype=h5py.string_dtype())


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("result") / "small.nc"
    save_result(synthetic_result(num_frames=3, num_draws=5), path)
    return path.read_bytes()


@pytest.mark.full
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (huge, ["posterior/more", "declares 2861 MiB", "its part of the file"]),
        (cycle, ["/posterior/again", "two names"]),
        (twice, ["/posterior/again", "two names"]),
        (wide, ["too many groups", f"at most {MAX_GROUPS}"]),
        (deep, ["too many groups", "8 levels"]),
        (soft_link, ["/posterior/link: a link"]),
        (external_link, ["/posterior/link: a link"]),
        (external_data, ["/posterior/raw", "elsewhere"]),
        (virtual_data, ["/posterior/virtual", "elsewhere"]),
        (texts, ["/posterior/texts", "200000 texts"]),
        (ragged, ["/posterior/ragged", "numbers or texts"]),
        (attributes, ["/posterior", "600 attributes"]),
        (text_attribute, ["/posterior", "40 texts"]),
    ],
)
def test_what_a_file_declares_is_bounded(
    tmp_path: Path,
    small: bytes,
    change: Callable[[h5py.File, Path], None],
    words: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "bad.nc").write_bytes(small)
    with h5py.File(tmp_path / "bad.nc", "r+") as file:
        change(file, tmp_path)
    assert main(["report", str(tmp_path / "bad.nc"), "-o", str(tmp_path / "report.html")]) == 1
    message = capsys.readouterr().err
    assert len(message.strip().splitlines()) == 1 and "bad.nc" in message
    for word in words:
        assert word in message


@pytest.mark.full
def test_the_limit_is_stated_and_can_be_raised(tmp_path: Path, small: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "long.nc").write_bytes(small)
    with h5py.File(tmp_path / "long.nc", "r+") as file:
        long_texts(file, tmp_path)
    path = tmp_path / "long.nc"
    with pytest.raises(InputError, match=r"declares 0\.0 GiB or more .expected at most 0\.00279 GiB; set POSEPPL_MAX_GIB"):
        check_netcdf(path, expected="a result", max_bytes=3_000_000)
    check_netcdf(path, expected="a result", max_bytes=4_000_000)
    monkeypatch.setenv("POSEPPL_MAX_GIB", "0.001")
    with pytest.raises(InputError, match="at most 0.001 GiB"):
        load_result(path)
    monkeypatch.setenv("POSEPPL_MAX_GIB", "much")
    with pytest.raises(InputError, match="POSEPPL_MAX_GIB: 'much'"):
        load_result(path)


@pytest.mark.full
def test_damaged_results_are_refused_or_read(tmp_path: Path, small: bytes) -> None:
    refused = 0
    for damaged in damaged_copies(small, 60):
        (tmp_path / "damaged.nc").write_bytes(damaged)
        try:
            load_result(tmp_path / "damaged.nc")
        except PosepplError as error:
            refused += 1
            assert "damaged.nc" in str(error) and "unexpected" not in str(error)
    assert refused > 10


@pytest.mark.full
@pytest.mark.parametrize(
    "change",
    [
        lambda file: file.__delitem__("summary/state_mean"),
        lambda file: file.__delitem__("posterior/markers"),
        lambda file: replace(file, "truth/state", np.full((2, 2), b"x")),
        lambda file: replace(file, "summary/markers_mean", np.full((3, 2), b"x")),
        lambda file: replace(file, "sample_stats/log_evidence", np.zeros((2, 2))),
    ],
)
def test_a_result_of_other_contents_is_never_unexpected(
    tmp_path: Path, small: bytes, capsys: pytest.CaptureFixture[str], change: Callable[[h5py.File], None]
) -> None:
    (tmp_path / "odd.nc").write_bytes(small)
    (tmp_path / "small.nc").write_bytes(small)
    with h5py.File(tmp_path / "odd.nc", "r+") as file:
        change(file)
    for command in ("report", "compare"):
        others = [str(tmp_path / "small.nc")] if command == "compare" else []
        status = main([command, *others, str(tmp_path / "odd.nc"), "-o", str(tmp_path / "page.html"), "-q"])
        message = capsys.readouterr().err
        assert "unexpected" not in message
        assert status == 0 or ("odd.nc" in message and len(message.strip().splitlines()) == 1)


def replace(file: h5py.File, name: str, values: np.ndarray) -> None:
    """Put other values in the place of a variable."""
    del file[name]
    file[name] = values
