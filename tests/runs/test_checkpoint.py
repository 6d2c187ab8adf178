"""Checkpoints: killed and resumed runs, other runs, damage."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from damage import deflated, unbalanced
from poseppl_models.toys.linear_gaussian import linear_gaussian
from waiting import wait_until

from poseppl.errors import InputError
from poseppl.files.store import Store
from poseppl.filters import Filter, FilterInfo, ParticleState
from poseppl.runs.checkpoint import Checkpoint, CheckpointError
from poseppl.runs.run import Run, RunError, run_filter

FRAMES = 22
MODEL = linear_gaussian(2).compile()
VALUES = np.sin(np.arange(FRAMES)[:, None] / 3 + np.arange(2))


def _info(noise: jax.Array) -> FilterInfo:
    zero, number = noise[0, 0], jnp.int32(1)
    return FilterInfo(zero, zero, jnp.arange(4, dtype=jnp.int32), zero, number, number, number, jnp.array(False), zero)


def _init(rng_key: Any, observation: Any, inputs: Any) -> Any:
    noise = jax.random.normal(rng_key, (4, 2))
    return ParticleState(noise, jnp.zeros(4)), _info(noise)


def _step(rng_key: Any, state: Any, observation: Any, inputs: Any) -> Any:
    noise = jax.random.normal(rng_key, (4, 2))
    return ParticleState(0.9 * state.particles + noise * observation.values["y"], jnp.zeros(4)), _info(noise)


FILTER = Filter(_init, _step)
"""Cheap to compile; what it draws depends on the whole past, the data and the key."""


def _collect(rng_key: Any, state: Any, info: FilterInfo, inputs: Any) -> Any:
    return {"particles": state.particles, "noise": jax.random.normal(rng_key, (3,))}


class Notes:
    """Collects notes; may stop the run after some frames."""

    def __init__(self, stop_at: int | None = None) -> None:
        self.frames, self.notes, self.stop_at = 0, [], stop_at

    def advance(self, frames: int) -> None:
        self.frames += frames
        if self.stop_at is not None and self.frames >= self.stop_at:
            raise KeyboardInterrupt

    def note(self, message: str) -> None:
        self.notes.append(message)


def go(folder: Path | None, *, resume: bool = False, values: Any = VALUES, settings: Any = None, **options: Any) -> Run:
    checkpoint = None if folder is None else Checkpoint(folder, settings or {"filter": "particle"}, resume=resume)
    return run_filter(
        FILTER,
        options.pop("key", jax.random.key(7)),
        MODEL.observe({"y": values}),
        num_frames=FRAMES,
        collect=_collect,
        checkpoint=checkpoint,
        chunk=4,
        **options,
    )


def assert_same(first: Run, second: Run) -> None:
    for name in ("outputs", "info", "unique_ancestors", "state"):
        jax.tree.map(np.testing.assert_array_equal, getattr(first, name), getattr(second, name))


@pytest.mark.full
def test_a_part_that_stops_the_run_is_not_kept(tmp_path: Path) -> None:
    wild = VALUES.copy()
    wild[6:8] = 3e38  # times a noise of some units: infinite
    with pytest.raises(RunError, match="not finite"):
        go(tmp_path / "run", values=wild)
    assert [path.name for path in sorted((tmp_path / "run").glob("part-*"))] == [
        "part-000000-000001.npz",
        "part-000001-000005.npz",
    ]


SCRIPT = """
import sys, time
sys.path[:0] = {folders!r}
import conftest
from pathlib import Path
import jax
jax.config.update("jax_compilation_cache_dir", str(conftest.CACHE))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
import test_checkpoint
class Slow(test_checkpoint.Notes):
    def advance(self, frames):
        super().advance(frames)
        time.sleep(0.01)
        if self.frames == 17:
            sys.stdin.read()  # until it is killed, if that is not before
test_checkpoint.go(Path(sys.argv[1]), progress=Slow())
"""


@pytest.mark.full
def test_a_run_killed_at_any_moment_resumes_bit_for_bit(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    script = SCRIPT.format(folders=[str(folder) for folder in Path(__file__).parents[:2]])
    with subprocess.Popen([sys.executable, "-c", script, str(folder)], stdin=subprocess.PIPE) as process:
        wait_until(lambda: len(list(folder.glob("part-*.npz"))) >= 3, process=process)
        process.kill()
    assert process.returncode == -signal.SIGKILL
    assert 3 <= len(list(folder.glob("part-*.npz"))) <= 5
    resumed = go(folder, resume=True)
    assert resumed.resumed in (9, 13, 17)
    assert_same(resumed, go(None))
    # a finished run is read back whole
    again = go(folder, resume=True)
    assert again.resumed == FRAMES
    assert_same(again, resumed)


def test_ctrl_c_leaves_a_valid_checkpoint(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        go(tmp_path / "run", progress=Notes(stop_at=9))
    told = Notes()
    resumed = go(tmp_path / "run", resume=True, progress=told)
    assert resumed.resumed == 9 and told.frames == FRAMES and told.notes == []
    assert_same(resumed, go(None))


@pytest.mark.full
@pytest.mark.parametrize("damage", ["truncated", "flipped", "empty", "other shapes", "unbalanced", "deflated"])
def test_a_damaged_part_is_computed_again(tmp_path: Path, damage: str) -> None:
    go(tmp_path / "run")
    part = tmp_path / "run" / "part-000005-000009.npz"
    data = part.read_bytes()
    if damage == "other shapes":
        np.savez(part, kept_0=np.zeros(3))
    else:
        middle = len(data) // 3
        flipped = data[:middle] + bytes(255 - byte for byte in data[middle : middle + 40]) + data[middle + 40 :]
        broken = {"truncated": data[: len(data) // 2], "flipped": flipped, "empty": b""}
        part.write_bytes({**broken, "unbalanced": unbalanced(data), "deflated": deflated(data)}[damage])
    (tmp_path / "run" / ".part-000009-000013.0123456789ab.tmp.npz").write_bytes(b"left behind")
    told = Notes()
    resumed = go(tmp_path / "run", resume=True, progress=told)
    assert resumed.resumed == 5
    assert len(told.notes) == 1 and "damaged" in told.notes[0]
    assert_same(resumed, go(None))
    assert not list((tmp_path / "run").glob(".*"))


def test_a_checkpoint_of_another_run_is_refused(tmp_path: Path) -> None:
    go(tmp_path / "run")
    with pytest.raises(CheckpointError, match="another run.*other data, inputs or seed"):
        go(tmp_path / "run", resume=True, values=VALUES + 1)
    with pytest.raises(CheckpointError, match="other data, inputs or seed"):
        go(tmp_path / "run", resume=True, key=jax.random.key(8))
    with pytest.raises(CheckpointError, match='filter: "particle" there, "hmc" here'):
        go(tmp_path / "run", resume=True, settings={"filter": "hmc"})
    with pytest.raises(CheckpointError, match="contains this run already"):
        go(tmp_path / "run")


def test_folders_that_hold_something_else_are_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("a life's work")
    with pytest.raises(CheckpointError, match="other files"):
        go(tmp_path)
    with pytest.raises(InputError, match="no checkpoint can be kept there"):
        go(tmp_path / "absent" / "run")
    with pytest.raises(InputError, match="no checkpoint can be kept there"):
        go(tmp_path / "thesis.tex")


@pytest.mark.full
@pytest.mark.parametrize("damage", ['{"version": 2, "fra', "", "\0\0\0", "[" * 100_000, "[]"])
def test_torn_settings_cost_nothing(tmp_path: Path, damage: str) -> None:
    with pytest.raises(KeyboardInterrupt):
        go(tmp_path / "run", progress=Notes(stop_at=9))
    (tmp_path / "run" / "settings.json").write_text(damage)
    told = Notes()
    resumed = go(tmp_path / "run", resume=True, progress=told)
    assert resumed.resumed == 9 and len(told.notes) == 1 and "damaged" in told.notes[0]
    assert_same(resumed, go(None))
    assert (tmp_path / "run" / "settings.damaged").read_text() == damage  # perhaps it was somebody's own
    assert go(tmp_path / "run", resume=True).resumed == FRAMES
    (tmp_path / "run" / "settings.json").write_text(damage)
    assert go(tmp_path / "run", resume=True, values=VALUES + 1).resumed == 0  # no part of another run is taken for its own


def test_killed_while_the_settings_are_written(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / ".settings.0123456789ab.tmp.json").write_text('{"ver')
    assert go(tmp_path / "run").resumed == 0
    assert go(tmp_path / "run", resume=True).resumed == FRAMES
    assert not list((tmp_path / "run").glob(".*"))


@pytest.mark.full
def test_bytes_changed_anywhere_in_a_part_mean_damaged(tmp_path: Path) -> None:
    whole = go(tmp_path / "run")
    part = tmp_path / "run" / "part-000005-000009.npz"
    data, rng = part.read_bytes(), np.random.default_rng(0)
    headers = [at for at in range(len(data)) if data.startswith(b"{'descr'", at)]
    damaged = 0
    for place in [*rng.integers(0, len(data), 20), *(at + shift for at in headers[:8] for shift in (0, 8, 12))]:
        mutated = bytearray(data)
        mutated[place] = rng.integers(256)
        part.write_bytes(mutated)
        told = Notes()
        assert_same(go(tmp_path / "run", resume=True, progress=told), whole)
        damaged += len(told.notes)
        assert all("damaged" in note for note in told.notes)
    assert damaged >= 30


def test_two_processes_at_one_checkpoint(tmp_path: Path) -> None:
    class Second(Notes):
        def advance(self, frames: int) -> None:
            if self.frames == 0:
                with pytest.raises(CheckpointError, match="another process is at this checkpoint"):
                    go(tmp_path / "run", resume=True)
            super().advance(frames)

    assert_same(go(tmp_path / "run", progress=Second()), go(None))
    assert go(tmp_path / "run", resume=True).resumed == FRAMES  # the lock is let go


def test_a_disk_that_is_full_for_a_while(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save, full = Store.save, iter([False, True, True])

    def write_array(stream: Any, array: Any, **options: Any) -> None:
        stream.write(b"half of it")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def save_on_full_disk(*arguments: Any) -> None:
        with monkeypatch.context() as patch:
            if next(full, False):
                patch.setattr(np.lib.format, "write_array", write_array)
            save(*arguments)

    monkeypatch.setattr(Store, "save", save_on_full_disk)
    told = Notes()
    run = go(tmp_path / "run", progress=told)
    assert len(told.notes) == 1 and "disk is full" in told.notes[0] and "not saved yet" in told.notes[0]
    monkeypatch.undo()
    assert_same(run, go(tmp_path / "run", resume=True))
    assert go(tmp_path / "run", resume=True).resumed == FRAMES


@pytest.mark.full
def test_nothing_is_pickled(tmp_path: Path) -> None:
    go(tmp_path / "run")
    for part in (tmp_path / "run").glob("part-*.npz"):
        with np.load(part, allow_pickle=False) as arrays:
            assert all(arrays[name].dtype.kind in "fiub" for name in arrays.files)
    described = json.loads((tmp_path / "run" / "settings.json").read_text())
    assert described["frames"] == FRAMES and described["filter"] == "particle"
