"""A process of its own in which ezc3d reads one file: ``python -P c3d_worker.py INPUT OUTPUT.npz``.

ezc3d is C++ and damaged files can make it end its process (segmentation fault) or exhaust the memory, which no Python code can
catch. So it runs here, under limits, and only arrays and texts come back. The file imports nothing from poseppl, to start fast.
"""

from __future__ import annotations

import contextlib
import json
import sys

MEMORY_BYTES = 4 * 2**30
CPU_SECONDS = 120


def limit_resources() -> None:
    """Bound the memory and the time of this process, where the system can."""
    try:
        import resource
    except ImportError:
        return
    for kind, bound in ((resource.RLIMIT_AS, MEMORY_BYTES), (resource.RLIMIT_CPU, CPU_SECONDS), (resource.RLIMIT_CORE, 0)):
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (bound, bound))


def convert(source: str, target: str) -> None:
    """Read a C3D file and write its points and the texts of its POINT group.

    Args:
        source: The .c3d file.
        target: The .npz file: ``points`` (4, K, T) in the file's unit and ``texts``, a JSON object in UTF-8 bytes.
    """
    import ezc3d
    import numpy as np

    file = ezc3d.c3d(source)
    texts = {}
    for name, parameter in file["parameters"]["POINT"].items():
        values = parameter.get("value", ()) if isinstance(parameter, dict) else ()
        if isinstance(values, list) and all(isinstance(value, str) for value in values):
            texts[name] = [value.encode("utf-8", "replace").decode("utf-8").strip() for value in values]
    encoded = np.frombuffer(json.dumps(texts).encode(), dtype=np.uint8)
    np.savez(target, points=np.asarray(file["data"]["points"], dtype=np.float64), texts=encoded)


if __name__ == "__main__":
    limit_resources()
    try:
        convert(sys.argv[1], sys.argv[2])
    except Exception as error:
        sys.exit(f"{error}"[:300])
