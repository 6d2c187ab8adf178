"""Loops over few bytes on a CPU: XLA may make one function of each, or run its operations as tasks of their own.

It does the first below 1,024 bytes. A task for each operation costs filters of up to some 10,000 particles a fifth to a half of
their time (`python -m benchmarks.small_loops`). XLA takes the limit from the environment variable XLA_FLAGS alone, when JAX
starts. The command line sets it. In Python the user sets it, before JAX is imported, because it affects everything that a
process compiles:

>>> from poseppl import small_loops
>>> small_loops.as_functions({"XLA_FLAGS": "--xla_dump_to=here"})["XLA_FLAGS"].split()[1]
'--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000'
"""

from __future__ import annotations

import os
from collections.abc import MutableMapping

SMALL = 1_000_000
"""Bytes of loops that are made one function."""
_OPTION, _NAME = "xla_backend_extra_options", "xla_cpu_small_while_loop_byte_threshold"


def as_functions(environment: MutableMapping[str, str] = os.environ) -> MutableMapping[str, str]:
    """Have loops of less than :data:`SMALL` bytes made one function each, unless the environment sets a limit.

    Args:
        environment: The mapping in which XLA_FLAGS is set, and which is returned; as it was if XLA_FLAGS names a file of flags.
    """
    given = environment.get("XLA_FLAGS", "").strip()
    if _NAME not in given and given[:1] in ("", "-"):
        environment["XLA_FLAGS"] = f"{given} --{_OPTION}={_NAME}={SMALL}".strip()
    return environment
