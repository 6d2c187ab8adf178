"""How a whole program is compiled, by how much it will compute.

XLA's fusion emitters for the CPU take a third of the time that compilation takes, and whole runs are no faster for them
(`python benchmarks/fusion_emitters.py`). A bare loop over 100,000 particles is, by half of its time (`python
benchmarks/filters.py --quick`, with and without `XLA_FLAGS=--xla_cpu_use_fusion_emitters=false`): programs of many particles
keep them, and smoothers, which compare particles in pairs, sooner than filters. Of few numbers, LLVM's first level of
optimisation makes runs as fast as its third, and takes less time (`python benchmarks/first_result.py --levels`). What runs once
a sequence, such as a filter's `init`, has at most the first level.

>>> lowered = jax.jit(lambda x: 2 * x).lower(1.5)
>>> float(compile_lowered(lowered, num_particles=100, num_numbers=300)(1.5))
3.0
"""

from __future__ import annotations

from typing import Any

import jax

MOST_PARTICLES = 10_000
"""Of filters that are compiled without the emitters."""
MOST_SMOOTHED = 1000
"""Particles of smoothers that are."""
MOST_NUMBERS = 1000
"""In the particles, as many as they are times their dimension, of programs of few numbers."""
_WITHOUT_EMITTERS = {"xla_cpu_use_fusion_emitters": False}
_LEVEL = "xla_backend_optimization_level"


def compile_lowered(lowered: Any, num_particles: int, num_numbers: int) -> Any:
    """The program of `jax.jit(...).lower(...)`, a filter's, ready to run."""
    return _compiled(lowered, _emitters(num_particles, MOST_PARTICLES) | ({_LEVEL: 1} if num_numbers <= MOST_NUMBERS else {}))


def compile_smoother(lowered: Any, num_particles: int) -> Any:
    """The program of a smoother."""
    return _compiled(lowered, _emitters(num_particles, MOST_SMOOTHED))


def compile_to_run_once(lowered: Any, num_particles: int, num_numbers: int) -> Any:
    """The program of `jax.jit(...).lower(...)` that runs once a sequence."""
    return _compiled(lowered, _emitters(num_particles, MOST_PARTICLES) | {_LEVEL: 0 if num_numbers <= MOST_NUMBERS else 1})


def _emitters(num_particles: int, most: int) -> dict[str, Any]:
    return _WITHOUT_EMITTERS if num_particles <= most else {}


def _compiled(lowered: Any, options: dict[str, Any]) -> Any:
    """The options are for a CPU; elsewhere, and where XLA does not know them, it compiles as it does."""
    if not options or jax.default_backend() != "cpu":
        return lowered.compile()
    try:
        return lowered.compile(compiler_options=options)
    except jax.errors.JaxRuntimeError:
        return lowered.compile()
