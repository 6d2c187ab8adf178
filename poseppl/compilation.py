"""How functions are compiled: how many bits their numbers have, how exact their products are, and by how much they compute.

On a GPU or TPU JAX rounds the factors of a product of float32 matrices to 10 bits or 7 by default: covariances are then off in
the third digit, and moves that are whitened by them leave another density invariant than the one asked for. Programs compiled
here multiply as a CPU does on every device, unless the user has set ``jax_default_matmul_precision``.

XLA's fusion emitters for the CPU take a third of the time that compilation takes, and whole runs are no faster for them
(`python -m benchmarks.fusion_emitters`). A bare loop over 100,000 particles is, by half of its time (`python
benchmarks/filters.py --quick`, with and without `XLA_FLAGS=--xla_cpu_use_fusion_emitters=false`): programs of many particles
keep them, and smoothers, which compare particles in pairs, sooner than filters. For few numbers, LLVM's first level of
optimisation makes runs as fast as its third, and takes less time (`python -m benchmarks.first_result --levels`). Programs that
run once a sequence, such as a filter's `init`, have at most the first level. So have smoothers that are formulas, or of few
numbers (`python -m benchmarks.compile_times` prints what they take to compile and to run). With JAX's option
`jax_disable_most_optimizations` every program has level 0, whatever is chosen here: the tests compile in half of the time.

>>> lowered = jit(lambda x: 2 * x).lower(1.5)
>>> float(compile_lowered(lowered, num_particles=100, num_numbers=300)(1.5))
3.0
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from typing import Any, ParamSpec, TypeVar

import jax

P = ParamSpec("P")
R = TypeVar("R")
_MARK = "_full_precision"
MAX_PARTICLES = 10_000
"""The largest number of particles of filters that are compiled without the emitters."""
MAX_SMOOTHED = 1000
"""Particles of smoothers that are."""
MAX_NUMBERS = 1000
"""The largest number of entries (particles times dimension) of programs of few numbers."""
_WITHOUT_EMITTERS = {"xla_cpu_use_fusion_emitters": False}
_LEVEL = "xla_backend_optimization_level"


def double_precision(wanted: bool = True) -> AbstractContextManager[Any]:
    """64-bit JAX arrays inside a block, or 32-bit ones, whatever the global setting; a block is of one thread."""
    namespace: Any = jax if hasattr(jax, "enable_x64") else import_module("jax.experimental")  # jax.experimental before JAX 0.8
    block: AbstractContextManager[Any] = namespace.enable_x64(wanted)
    return block


def full_precision() -> AbstractContextManager[Any]:
    """Products of float32 in float32 for what is traced inside a block; on a CPU they are anyway, and nothing changes."""
    chosen = getattr(jax.config, "jax_default_matmul_precision", None)
    return nullcontext() if chosen or jax.default_backend() == "cpu" else jax.default_matmul_precision("highest")


def with_full_precision(function: Callable[P, R]) -> Callable[P, R]:
    """The function, traced in :func:`full_precision`; itself where it is, so that what was compiled for it serves again."""
    if hasattr(function, _MARK):
        return function

    @functools.wraps(function)
    def precise(*args: P.args, **kwargs: P.kwargs) -> R:
        with full_precision():
            return function(*args, **kwargs)

    setattr(precise, _MARK, True)
    return precise


def jit(function: Callable[..., Any], **options: Any) -> jax.stages.Wrapped:
    """`jax.jit` of a function in :func:`full_precision`."""
    return jax.jit(with_full_precision(function), **options)


def compile_lowered(lowered: Any, num_particles: int, num_numbers: int) -> Any:
    """The program of `jit(...).lower(...)`, a filter's, ready to run."""
    return _compiled(lowered, _emitters(num_particles, MAX_PARTICLES) | ({_LEVEL: 1} if num_numbers <= MAX_NUMBERS else {}))


def jit_lightly(function: Callable[..., Any], **options: Any) -> jax.stages.Wrapped:
    """`jit` of what runs a few times a sequence, with LLVM's first level of optimisation; not for use within other programs."""
    return jit(function, compiler_options=_admitted({_LEVEL: 1}), **options)


def compile_smoother(lowered: Any, num_particles: int, num_numbers: int, closed_form: bool) -> Any:
    """The program of a smoother, which may be a formula."""
    few = closed_form or num_numbers <= MAX_NUMBERS
    return _compiled(lowered, _emitters(num_particles, MAX_SMOOTHED) | ({_LEVEL: 1} if few else {}))


def compile_to_run_once(lowered: Any, num_particles: int, num_numbers: int) -> Any:
    """The program of `jit(...).lower(...)` that runs once a sequence."""
    return _compiled(lowered, _emitters(num_particles, MAX_PARTICLES) | {_LEVEL: 0 if num_numbers <= MAX_NUMBERS else 1})


def jit_formula(function: Callable[..., Any], *, runs_once: bool = False) -> jax.stages.Wrapped:
    """`jit` of a function without particles, which no other program calls: few numbers, or large products of matrices.

    It is compiled without the emitters, with LLVM's first level of optimisation; with none where it runs once.
    """
    options = _WITHOUT_EMITTERS | {_LEVEL: int(not runs_once)} if _knows_options() else {}
    return jit(function, compiler_options=_admitted(options))


@functools.cache
def _knows_options() -> bool:
    """Whether programs are compiled for a CPU, by a version of XLA that knows the options."""
    if jax.default_backend() != "cpu":
        return False
    options: Any = _WITHOUT_EMITTERS | {_LEVEL: 1}
    try:
        jit(lambda x: x).lower(0.0).compile(compiler_options=options)
    except jax.errors.JaxRuntimeError:
        return False
    return True


def _emitters(num_particles: int, most: int) -> dict[str, Any]:
    return _WITHOUT_EMITTERS if num_particles <= most else {}


def _compiled(lowered: Any, options: dict[str, Any]) -> Any:
    """The options are for a CPU; elsewhere, and where XLA does not know them, it compiles as it does."""
    options = _admitted(options)
    if not options or jax.default_backend() != "cpu":
        return lowered.compile()
    try:
        return lowered.compile(compiler_options=options)
    except jax.errors.JaxRuntimeError:
        return lowered.compile()


def _admitted(options: dict[str, Any]) -> dict[str, Any]:
    """The options without a level of optimisation where JAX is configured to use the lowest."""
    config: Any = jax.config
    lowest = config.read("jax_disable_most_optimizations")
    return {name: value for name, value in options.items() if not (lowest and name == _LEVEL)}
