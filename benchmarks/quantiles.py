"""The sorting network beside XLA's own sort: many columns, as a collector sorts them for each frame.

python -m benchmarks.quantiles [--quick]
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp

from benchmarks.timing import arguments, interleave, show
from poseppl.particles.quantiles import sort_rows

COLUMNS = 113
"""States, markers and projections of the 28-DOF body seen by one camera."""


def main() -> None:
    options = arguments(__doc__)
    network, rival = jax.jit(sort_rows), jax.jit(partial(jnp.sort, axis=0))
    rows = []
    for number in (600,) if options.quick else (600, 2000):
        values = jax.random.normal(jax.random.key(0), (number, COLUMNS))
        found = interleave({"own": partial(network, values), "rival": partial(rival, values)}, 30)
        own, other = (1e3 * found[name].median for name in ("own", "rival"))
        rows.append([str(number), f"{own:.2f}", f"{other:.2f}", f"{other / own:.1f}"])
    show(f"{COLUMNS} columns sorted", ["draws", "network, ms", "XLA's sort, ms", "ratio"], rows)


if __name__ == "__main__":
    main()
