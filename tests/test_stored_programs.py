"""Programs that the command line stores: found without tracing, and only where nobody else can have put them."""

import hashlib
import os
import pickle
import shutil
import stat
from pathlib import Path

import jax
import numpy as np
import pytest
from jax.experimental.compilation_cache.compilation_cache import reset_cache
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model

import poseppl
from poseppl import stored_programs
from poseppl.cli.console import start_jax
from poseppl.compilation import double_precision
from poseppl.runs.collectors import collect_draws
from poseppl.runs.run import run_filter
from poseppl.stored_programs import key_of, recalled, store_programs, stored_jit

TRACED: list[str] = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, seconds, **more: TRACED.append(str(more.get("fun_name"))) if event.endswith("jaxpr_trace_duration") else None
)
OF_A_RUN = {"start", "one_frame", "scan_frames"}


@pytest.fixture(scope="module", autouse=True)
def no_cache():
    """Nothing comes from XLA's cache, whose programs are not stored."""
    before = jax.config.jax_enable_compilation_cache
    jax.config.update("jax_enable_compilation_cache", False)
    reset_cache()
    yield
    jax.config.update("jax_enable_compilation_cache", before)
    reset_cache()


@pytest.fixture
def folder(tmp_path):
    """An empty folder of programs."""
    store_programs(tmp_path / "programs")
    yield tmp_path / "programs"
    store_programs(None)


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A run, what was traced of it, and what it stored."""
    folder = tmp_path_factory.mktemp("stored") / "programs"
    store_programs(folder)
    found, traced = filtered(), OF_A_RUN & set(TRACED)
    store_programs(None)
    return found, traced, list(folder.iterdir())


def numbers(tree):
    return jax.tree.map(np.asarray, [leaf for leaf in jax.tree.leaves(tree) if np.asarray(leaf).dtype.kind in "fiub"])


def filtered():
    """A run of a model that is built for it, which finds nothing of an earlier run in memory."""
    TRACED.clear()
    model = linear_gaussian_model(linear_gaussian_matrices()).compile()
    filter, data = poseppl.kalman_filter(model), model.observe({"y": np.ones((4, 1))})
    run = run_filter(filter, jax.random.key(1), data, collect=collect_draws(model, max_draws=5))
    return numbers((run.outputs, run.info, run.state))


def equal(one, other):
    return all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(one, other, strict=True))


def test_a_second_run_traces_nothing_and_is_the_same(stored, folder):
    first, traced, files = stored
    for path in files:
        shutil.copy2(path, folder)
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert traced == OF_A_RUN
    assert equal(filtered(), first) and not OF_A_RUN & set(TRACED)


def test_damaged_programs_are_made_again(stored, folder):
    first, _, files = stored
    for path in files:
        shutil.copy2(path, folder)
        whole, copy = path.read_bytes(), folder / path.name
        for place in (0, len(whole) // 2, -1):
            copy.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place:][1:])
            with pytest.raises(ValueError, match="damaged"):
                stored_programs._content(copy)
        copy.write_bytes(whole if len(whole) == max(path.stat().st_size for path in files) else whole[:-1])
    assert equal(filtered(), first) and {"start", "one_frame"} <= set(TRACED)
    assert equal(filtered(), first) and not OF_A_RUN & set(TRACED)


def test_keys_are_of_sources_settings_and_models(folder, monkeypatch):
    def key(num_draws=5, **given):
        model = linear_gaussian_model(linear_gaussian_matrices(1, **given)).compile()
        return key_of(np.zeros(1), poseppl.kalman_filter(model), collect_draws(model, max_draws=num_draws))

    assert key() == key()
    monkeypatch.setattr(stored_programs, "digest_of_code", lambda: "other sources")
    changed = key()
    monkeypatch.undo()
    assert len({key(), changed, key(num_draws=6), key(Q=[[0.3]]), None}) == 5


def weighted_sum(count, values, weight):
    return weight * sum(values[index] for index in range(count))


def test_a_stored_function_is_traced_once_for_what_it_is_given(folder, monkeypatch):
    monkeypatch.setattr(stored_programs, "digest", lambda *parts: hashlib.sha256(repr(parts).encode()).hexdigest())
    values = np.arange(4, dtype=np.float32)

    def found(count, weight):
        TRACED.clear()
        fresh = stored_jit(weighted_sum, num_static=1)  # as in another process
        return float(fresh(count, values, weight)), TRACED.count("weighted_sum")

    assert found(2, 2.0) == (2.0, 1) and found(2, 3.0) == (3.0, 0)
    assert found(3, 2.0) == (6.0, 1) and found(3, 2) == (6.0, 1)
    with double_precision():
        assert found(2, 2.0) == (2.0, 1)
    store_programs(None)
    assert found(2, 2.0) == (2.0, 1)


class Foreign:
    """Attack by a pickle of somebody else."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def planted(folder: Path, key: str, ran: Path) -> Path:
    """An entry of a right checksum whose content runs code."""
    recalled(key, "x", lambda: np.zeros(1))
    (path,) = folder.iterdir()
    stored_programs._write(path, pickle.dumps((False, Foreign(ran))))
    return path


@pytest.mark.parametrize("of_others", ["file", "link", "owner", "folder"])
def test_what_others_may_write_is_not_unpickled(folder, tmp_path, monkeypatch, of_others):
    path = planted(folder, "key", ran := tmp_path / "ran")
    if of_others == "file":
        path.chmod(0o660)
    elif of_others == "link":
        path.rename(tmp_path / "elsewhere")
        path.symlink_to(tmp_path / "elsewhere")
    elif of_others == "owner":
        monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    else:
        folder.chmod(0o770)
        store_programs(folder)
    assert recalled("key", "x", lambda: 7) == 7 and not ran.exists()


def test_the_plant_runs_where_it_may(folder, tmp_path):
    planted(folder, "key", ran := tmp_path / "ran")
    recalled("key", "x", lambda: 7)
    assert ran.exists()


def test_an_entry_under_another_name_is_damaged(folder):
    recalled("one", "x", lambda: 1)
    (path,) = folder.iterdir()
    recalled("two", "x", lambda: 2)
    (other,) = set(folder.iterdir()) - {path}
    other.write_bytes(path.read_bytes())
    assert recalled("two", "x", lambda: 3) == 3


def test_what_was_not_used_for_longest_goes(folder, monkeypatch):
    for day, name in enumerate("abc"):
        before = set(folder.iterdir())
        recalled("key", name, lambda: np.zeros(1000))
        (path,) = set(folder.iterdir()) - before
        os.utime(path, (day, day))
    recalled("key", "a", lambda: None)  # used now
    monkeypatch.setattr(stored_programs, "MAX_BYTES", 3 * 8500)
    recalled("key", "d", lambda: np.zeros(1000))
    made = [name for name in "acdb" if recalled("key", name, lambda: None) is None]
    assert made == ["b"]


def test_nothing_is_stored_of_models_of_users_nor_where_nothing_is_kept(folder):
    assert key_of(np.zeros(1), abs) is not None
    assert key_of(np.zeros(1), filtered) is None  # a function of this file
    store_programs(None)
    assert key_of(np.zeros(1), abs) is None
    assert recalled(None, "x", lambda: 5) == 5 and not list(folder.iterdir())


def test_a_key_depends_on_shapes_types_and_precision(folder):
    given = [
        np.zeros(1, np.float32),
        np.zeros(2, np.float32),
        np.zeros(1, np.int32),
        (np.zeros(1, np.float32),),
        jax.random.key(0),
    ]
    keys = [key_of(data, abs) for data in given]
    with double_precision():
        keys += [key_of(given[0], abs)]
    assert len({*keys}) == len(keys) and None not in keys
    assert key_of(np.ones(1, np.float32), abs) == keys[0]


def test_what_xla_loaded_is_not_stored(folder):
    """XLA leaves functions out when it writes a program that it has loaded."""

    def make():
        jax.monitoring.record_event("/jax/compilation_cache/cache_hits")
        return 7

    assert recalled("key", "x", make) == 7 and not list(folder.iterdir())


def test_commands_store_programs_unless_the_environment_names_a_cache(tmp_path, monkeypatch):
    settings = {}
    monkeypatch.setattr(jax.config, "update", settings.__setitem__)
    monkeypatch.setattr(stored_programs, "store_programs", lambda folder: settings.update(programs=folder))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "elsewhere")
    start_jax()
    assert settings == {}
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    start_jax()
    assert settings["programs"] == tmp_path / "poseppl" / "programs"
    assert Path(settings["jax_compilation_cache_dir"]).parent == tmp_path / "poseppl" / "xla"
    assert settings["jax_persistent_cache_min_compile_time_secs"] == 0
