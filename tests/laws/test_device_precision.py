"""Laws on products of matrices: as exact on a GPU, which would round their factors, as on a CPU."""

from __future__ import annotations

import ast
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import FILTERS, SMOOTHERS, is_first, rows
from law_problems import problem

import poseppl
from poseppl.compilation import full_precision, jit
from poseppl.filters import particle_filter
from poseppl.kernels import HMC_MOVES, RANDOM_WALK_MOVES, HMCSettings
from poseppl.kernels.hmc import hmc_chains
from poseppl.kernels.laplace import find_modes
from poseppl.kernels.moves import evaluate, move_population, whitening_from_gradients
from poseppl.particles.weights import weighted_covariance
from poseppl.runs.run import run_filter
from poseppl.smoothers import collect_history

KEY = jax.random.key(0)
ROOT = Path(poseppl.__file__).parents[1]


@pytest.fixture
def on_gpu(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")


def inner(value):
    """The jaxprs within a parameter of an equation."""
    if isinstance(value, jax.extend.core.ClosedJaxpr):
        return [value.jaxpr]
    if isinstance(value, jax.extend.core.Jaxpr):
        return [value]
    return [part for each in value for part in inner(each)] if isinstance(value, tuple | list) else []


def products(jaxpr):
    """The precisions of all products of floats."""
    for equation in jaxpr.eqns:
        if equation.primitive.name == "dot_general" and jnp.issubdtype(equation.outvars[0].aval.dtype, jnp.floating):
            yield equation.params["precision"]
        for value in equation.params.values():
            for part in inner(value):
                yield from products(part)


def precisions(function, *arguments):
    return {str(precision) for precision in products(jax.make_jaxpr(function)(*arguments).jaxpr)}


@rows(FILTERS, is_first, lambda row: row.name in ("particle", "kalman"))
def test_filters_multiply_exactly(row, on_gpu):
    posed = problem()
    built = row.build(posed.model)
    state, _ = jax.eval_shape(built.init, KEY, *posed.at(0))
    found = precisions(built.init, KEY, *posed.at(0)) | precisions(built.step, KEY, state, *posed.at(1))
    assert "None" not in found and "DEFAULT" not in " ".join(found)


@rows(SMOOTHERS, is_first, lambda row: row.name in ("genealogy", "rauch-tung-striebel"))
def test_smoothers_multiply_exactly(row, on_gpu):
    posed = problem()
    filtered = particle_filter(posed.model, 50)
    run = run_filter(filtered, KEY, posed.observations, posed.inputs, collect=collect_history)
    found = precisions(
        row.build(posed.model).smooth, KEY, jax.tree.map(jnp.asarray, run.outputs), posed.observations, posed.inputs
    )
    assert "None" not in found and "DEFAULT" not in " ".join(found)


def test_products_are_those_of_the_users_choice(on_gpu):
    square = np.ones((3, 3), np.float32)

    def chosen():
        return precisions(jit(lambda x: x @ x), square)

    assert "HIGHEST" in str(chosen())
    with jax.default_matmul_precision("tensorfloat32"):
        assert "HIGHEST" not in str(chosen())
    assert precisions(jax.jit(lambda x: x @ x), square) == {"None"}


def moved(moves):
    """Moves of a Gaussian population, compiled by the caller."""
    white = jnp.eye(3) + 0.1

    def log_density(x, context):
        return -0.5 * (x - context) @ white @ (x - context)

    def run(positions):
        starts = evaluate(positions, positions + 1, log_density, moves)
        keys = jax.random.split(KEY, len(positions))
        return move_population(keys, starts, log_density, whitening_from_gradients(starts), jnp.log(0.1), moves)

    return run


def chains(positions):
    settings = HMCSettings(num_updates=4, num_leapfrog=2, num_warmup=2)
    white = jnp.eye(3) + 0.1
    return hmc_chains(KEY, positions, lambda x: -0.5 * x @ white @ x, jnp.log(0.1), settings)


def modes(positions):
    white = jnp.eye(3) + 0.1
    return find_modes(positions, lambda x: -0.5 * x @ white @ x, lambda x: white, 2)


@pytest.mark.parametrize(
    "kernel",
    [moved(HMC_MOVES), moved(RANDOM_WALK_MOVES), chains, modes, lambda x: weighted_covariance(x, x[:, 0])],
    ids=["HMC moves", "random-walk moves", "chains", "modes", "covariance"],
)
def test_kernels_that_are_compiled_by_their_callers_multiply_exactly(kernel, on_gpu):
    found = precisions(kernel, np.ones((5, 3), np.float32))
    assert found == {"(Precision.HIGHEST, Precision.HIGHEST)"}


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="it is of a CPU")
def test_a_cpu_keeps_its_programs():
    with full_precision():
        assert precisions(lambda x: x @ x, np.ones((3, 3), np.float32)) == {"None"}


def test_only_one_place_compiles():
    """Elsewhere `jax.jit` would compile products that are rounded."""
    for path in [*ROOT.glob("poseppl/**/*.py"), *ROOT.glob("models/poseppl_models/**/*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and node.attr == "jit" and path != ROOT / "poseppl/compilation.py":
                raise AssertionError(f"{path.relative_to(ROOT)}:{node.lineno}: jit of poseppl.compilation, not of jax")
