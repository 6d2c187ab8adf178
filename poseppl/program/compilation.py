"""How a whole program is compiled, by how much it will compute.

XLA's fusion emitters for the CPU take a quarter to a third of the time that compilation takes. Loops over many particles run up
to twice as fast for them; with few particles a run saves less in an hour than they cost.

>>> lowered = jax.jit(lambda x: 2 * x).lower(1.5)
>>> float(compile_lowered(lowered, num_particles=100)(1.5))
3.0
"""

from __future__ import annotations

from typing import Any

import jax

_FEW = 1000
_WITHOUT_EMITTERS = {"xla_cpu_use_fusion_emitters": False}


def compile_lowered(lowered: Any, num_particles: int) -> Any:
    """The program of `jax.jit(...).lower(...)`, ready to run; an XLA that does not know the emitters compiles as it does."""
    if num_particles > _FEW:
        return lowered.compile()
    try:
        return lowered.compile(compiler_options=_WITHOUT_EMITTERS)
    except jax.errors.JaxRuntimeError:
        return lowered.compile()
