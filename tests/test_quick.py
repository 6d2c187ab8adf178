"""The subset that also runs on the newest Python and the newest releases: imports, laws, the main job at a tiny size."""

from __future__ import annotations

import ast
import doctest
import importlib
import os
import pkgutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import arviz_stats
import jax
import jax.numpy as jnp
import numpy as np
import poseppl_models
import pytest
from catalogue import FILTERS, FilterRow, rows
from oracles.kalman import kalman_filter, simulate
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model
from waiting import PATIENCE

import poseppl
from poseppl.cli import main
from poseppl.motion.geometry import marker_positions
from poseppl.runs.contents import FLAT
from poseppl.runs.results import load_result

pytestmark = pytest.mark.quick

EXTRAS = ("ezc3d", "cv2")
MODULES = [
    module.name
    for package in (poseppl, poseppl_models)
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + ".")
]
CHOSEN = [row for row in FILTERS if row.name in ("particle", "hmc", "assumed-density")]


def run_python(code: str, *arguments: str) -> str:
    """Output of a new process; warnings are errors in it."""
    environment = os.environ | {"PYTHONWARNINGS": "error"}
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], check=False, capture_output=True, text=True, timeout=PATIENCE, env=environment
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


BASE = """
import importlib, sys
blocked = {"ezc3d", "cv2", "pytest", "hypothesis", "selenium"}
class Block:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in blocked:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Block())
for name in sys.argv[1:]:
    importlib.import_module(name)
"""


@pytest.mark.full
def test_every_module_is_imported_by_a_base_install() -> None:
    run_python(BASE, *MODULES)


@pytest.mark.full
def test_a_base_install_names_the_extra_that_a_file_needs() -> None:
    code = """
from poseppl.errors import PosepplError
from poseppl.motion.io import read_image
try:
    read_image("front.png")
except PosepplError as error:
    print(error)
"""
    assert "poseppl[vision]" in run_python(f"{BASE}\n{code}")


def test_importing_the_packages_loads_nothing_else() -> None:
    """Neither the numerical stack nor anything that draws."""
    code = """
import sys
import poseppl, poseppl_models
heavy = ("jax", "numpy", "scipy", "numpyro", "blackjax", "xarray", "matplotlib", "plotly", "rich", "arviz", "arviz_stats")
print(*(name for name in heavy if name in sys.modules))
poseppl.InputError
import poseppl.runs.run, poseppl.filters, poseppl.runs.collectors
print(*(name for name in ("matplotlib", "plotly", "arviz", "h5netcdf", "rich", "click", *sys.argv[1:]) if name in sys.modules))
"""
    loaded, drawing = run_python(code, *EXTRAS).split("\n")[:2]
    assert loaded == "" and drawing == ""


def test_public_names_are_found_and_are_the_same_for_type_checkers() -> None:
    tree = ast.parse(Path(poseppl.__file__).read_text(encoding="utf-8"))
    typed = {
        alias.asname: (node.module, alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("poseppl")
        for alias in node.names
    }
    assert sorted(typed) == poseppl.__all__
    for public, (module, name) in typed.items():
        assert public == name
        assert getattr(poseppl, public) is getattr(importlib.import_module(module), name)
        assert public in dir(poseppl)
    with pytest.raises(AttributeError, match="no attribute 'kalman'"):
        _ = poseppl.kalman


@pytest.mark.parametrize("package", [poseppl, poseppl_models])
def test_the_packages_tell_type_checkers_that_they_are_typed(package: object) -> None:
    assert Path(str(package.__file__)).with_name("py.typed").is_file()


@pytest.mark.full
@pytest.mark.parametrize("name", ["poseppl", "poseppl.program", "poseppl.runs.results", "poseppl_models.bodies.choo_fleet"])
def test_examples_in_docstrings_are_true(name: str) -> None:
    results = doctest.testmod(importlib.import_module(name))
    assert results.attempted > 0 and results.failed == 0


TINY = {
    "assumed-density": ["num_chains=4", "num_updates=12", "num_leapfrog=4", "num_warmup=2", "num_starts=4"],
    "particle": ["num_particles=100"],
}


@pytest.mark.full
@pytest.mark.parametrize("name", TINY)
def test_the_main_job_at_a_tiny_size(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "result.nc"
    settings = [word for setting in TINY[name] for word in ("--set", setting)]
    arguments = ["track", "--frames", "0:4", "--filter", name, *settings, "--max-draws", "10", "-o", str(target)]
    assert main(arguments) == 0
    assert "mean joint error" in capsys.readouterr().out
    assert target.with_suffix(".png").stat().st_size > 10_000
    tree = load_result(target)
    chains = 1 if name == "particle" else 4
    assert tree["unconstrained_posterior/state"].shape == (chains, 10, 4, 28)
    assert tree["posterior/markers"].shape == (chains, 10, 4, 17, 3)
    assert np.isfinite(tree["unconstrained_posterior/state"]).all() and not tree["sample_stats/failed"].any()
    assert float(tree["diagnostics/joint_error"].mean()) < 300
    if name == "assumed-density":
        check_arviz(tree)
        assert main(["report", str(target)]) == 0
        assert target.with_suffix(".html").stat().st_size > 100_000


def check_arviz(tree: object) -> None:
    """Its functions accept the result unchanged, and agree with the result's own diagnostics."""
    table = arviz_stats.summary(tree, var_names=["state"], group=FLAT)
    assert len(table) == 4 * 28 and {"mean", "sd"} <= set(table.columns)
    effective, rhat = (function(tree, var_names=["state"], group=FLAT) for function in (arviz_stats.ess, arviz_stats.rhat))
    assert effective["state"].shape == rhat["state"].shape == (4, 28)
    assert (effective["state"] > 0).all() and (rhat["state"] > 0.5).all()
    np.testing.assert_allclose(arviz_stats.ess(tree, method="mean", group=FLAT)["state"], tree["diagnostics/ess"], rtol=1e-3)
    np.testing.assert_allclose(arviz_stats.rhat(tree, method="split", group=FLAT)["state"], tree["diagnostics/rhat"], rtol=1e-3)


MATRICES = linear_gaussian_matrices(2)
_, YS = simulate(MATRICES, 4, seed=3)
MASK = np.array([[True, True], [True, False], [False, False], [True, True]])
NUM_REPLICATES = 20


def keep(rng_key: jax.Array, state: object, info: object, inputs: object) -> tuple[jax.Array, jax.Array]:
    """Weighted means (T, d), and the particles."""
    weights = jnp.exp(state.log_weights - jax.nn.logsumexp(state.log_weights))
    return jnp.sum(weights[..., None] * state.particles, tuple(range(weights.ndim))), state.particles


@cache
def posed(row: FilterRow) -> tuple[poseppl.Filter, poseppl.Observation]:
    """The filter of a row for the toy, compiled once for all tests, and data with gaps."""
    model = linear_gaussian_model(MATRICES).compile()
    return row.build(model), model.observe({"y": YS}, {"y": MASK})


@pytest.mark.full
@rows(CHOSEN)
def test_means_are_kalman_s(row: FilterRow) -> None:
    """Within five standard errors of independent runs; the paper's filter, which has no exact limit, at its first frame."""
    filter, data = posed(row)
    keys = jax.random.split(jax.random.key(7), NUM_REPLICATES)
    means = np.stack([poseppl.run_filter(filter, key, data, collect=keep).outputs[0] for key in keys])
    frames = slice(None) if row.consistent else slice(0, 1)
    exact = kalman_filter(MATRICES, YS, MASK).means
    error = np.maximum(means.std(0, ddof=1) / np.sqrt(NUM_REPLICATES), 1e-6)

    def agrees(expected: np.ndarray) -> bool:
        return bool((abs(means.mean(0) - expected)[frames] < 5 * error[frames]).all())

    assert agrees(exact)
    assert not agrees(kalman_filter(MATRICES, YS + 0.5).means)


@pytest.mark.full
@rows(CHOSEN)
def test_frames_one_by_one_give_what_the_sequence_gives(row: FilterRow) -> None:
    filter, data = posed(row)
    key = jax.random.key(1)
    _, particles = poseppl.run_filter(filter, key, data, collect=keep).outputs
    online = poseppl.Online(filter, key)
    for t in range(len(YS)):
        state, _ = online.update(jax.tree.map(lambda leaf, t=t: leaf[t], data))
        np.testing.assert_allclose(state.particles, particles[t], rtol=1e-3, atol=1e-3)


@pytest.mark.full
def test_kinematics_derivatives_are_those_of_differences() -> None:
    tree = importlib.import_module("poseppl_models.bodies.choo_fleet").full_body().tree
    with jax.enable_x64(True):
        x = jnp.asarray(np.random.default_rng(0).uniform(-1, 1, tree.dimension))
        jacobian = jax.jacrev(lambda x: marker_positions(tree, x))(x)
        steps = 1e-5 * jnp.eye(tree.dimension)
        difference = [(marker_positions(tree, x + h) - marker_positions(tree, x - h)) / 2e-5 for h in steps]
        np.testing.assert_allclose(jacobian, jnp.moveaxis(jnp.stack(difference), 0, -1), rtol=1e-6, atol=1e-4)
