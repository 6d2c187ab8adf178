"""Does smoothing pay when the state has more dimensions? Section 7.1 and Fig. 14 of Peursum, Venkatesh and West 2010.

    python benchmarks/dimensionality.py [--quick] [--runs 50] [--smallest 100] [--largest 50000] [--folder DIR]

The growth model in one and in three dimensions, T = 100, 100 to 50,000 particles (doi:10.1007/s11263-009-0205-5). Each run
draws its own truth and data; the error is the root mean square distance of the estimated means from the truth, over frames
and coordinates. The paper made one run for each number of particles; here are many, with standard errors, and the ratio of
smoothed to filtered error is that of the means over the runs. Beside the filter and forward-backward smoothing (FBS) stand the
other particle smoothers, and "exact": the error of the exact means from quadrature, below which nothing can fall.
O(N^2) smoothers stop at --quadratic particles in the other smoothers' rows; FBS goes all the way.
Prints a table, and writes dimensionality.csv and dimensionality.png to --folder when one is given.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import matplotlib
import numpy as np
from growth_problem import Growth, growth_sets, run_of
from timing import show

from poseppl.program import CompiledModel
from poseppl.smoothers import Smoother, backward_simulation_smoother, forward_backward_smoother, two_filter_smoother

Builder = Callable[[CompiledModel, int], Smoother]


class Method(NamedTuple):
    """A smoother, and whether its time grows with N^2."""

    name: str
    build: Builder
    quadratic: bool = False


FBS = Method("FBS", lambda model, num: forward_backward_smoother(model), quadratic=True)
OTHERS = [
    Method(
        "backward simulation, 5 moves", lambda m, num: backward_simulation_smoother(m, num, method="metropolis", num_moves=5)
    ),
    Method("two-filter, 4 pairs", lambda m, num: two_filter_smoother(m, method="linear")),
    Method("two-filter, exact", lambda m, num: two_filter_smoother(m), quadratic=True),
]


class Row(NamedTuple):
    """Errors of one method over all runs: means, standard errors, and the ratio to the filter's with its standard error."""

    dimension: int
    num_particles: int
    method: str
    runs: int
    error: float
    standard_error: float
    ratio: float
    ratio_error: float


def errors_of(posed: Growth, num_particles: int, build: Builder) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Errors of filtered and smoothed means from the truth, one for each run."""
    run = run_of(posed, num_particles, build)
    pairs = []
    for index in range(len(posed.truth)):
        observations = jax.tree.map(lambda leaf, index=index: leaf[index], posed.observations)
        pairs.append([distance(mean, posed.truth[index]) for mean in run(jax.random.key(index), observations)])
    filtered, smoothed = np.array(pairs).T
    return filtered, smoothed


def distance(means: Any, truth: np.ndarray[Any, Any]) -> float:
    """Root mean square over frames and coordinates."""
    return float(np.sqrt(np.mean((np.asarray(means) - truth) ** 2)))


def summarise(dimension: int, num_particles: int, method: str, errors: Any, filtered: Any) -> Row:
    """One row; the ratio's standard error is that of a quotient of means (delta method)."""
    count = len(errors)
    ratio = errors.mean() / filtered.mean()
    spread = (errors - ratio * filtered).std(ddof=1) / filtered.mean() / count**0.5
    return Row(dimension, num_particles, method, count, errors.mean(), errors.std(ddof=1) / count**0.5, ratio, spread)


def study(dimension: int, counts: Sequence[int], num_runs: int, quadratic: int) -> list[Row]:
    """All rows of one dimension."""
    posed = growth_sets(num_runs, dimension=dimension, seed=dimension)
    rows = []
    exact = [
        np.array([distance(mean, truth) for mean, truth in zip(means, posed.truth, strict=True)])
        for means in (posed.filtered, posed.smoothed)
    ]
    rows.append(summarise(dimension, 0, "exact filter", exact[0], exact[0]))
    rows.append(summarise(dimension, 0, "exact smoother", exact[1], exact[0]))
    for num_particles in counts:
        for method in [FBS, *OTHERS]:
            if method is not FBS and method.quadratic and num_particles > quadratic:
                continue
            filtered, smoothed = errors_of(posed, num_particles, method.build)
            if method is FBS:
                rows.append(summarise(dimension, num_particles, "filter", filtered, filtered))
            rows.append(summarise(dimension, num_particles, method.name, smoothed, filtered))
            row = rows[-1]
            print(
                f"d = {dimension}, N = {num_particles:,}, {method.name}: {row.error:.2f}, {row.ratio:.2f} of the filter's",
                flush=True,
            )
    return rows


def draw(rows: Sequence[Row], path: Path) -> None:
    """Fig. 14: errors above, ratios to the filter below; one column a dimension."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    dimensions = sorted({row.dimension for row in rows})
    figure, axes = plt.subplots(2, len(dimensions), figsize=(6 * len(dimensions), 8), squeeze=False)
    for column, dimension in enumerate(dimensions):
        above, below = axes[:, column]
        for number, name in enumerate(dict.fromkeys(row.method for row in rows if row.num_particles)):
            style: dict[str, Any] = {"label": name, "color": f"C{number}", "capsize": 3}
            mine = [row for row in rows if row.method == name and row.dimension == dimension]
            counts = [row.num_particles for row in mine]
            above.errorbar(counts, [row.error for row in mine], [row.standard_error for row in mine], **style)
            if name != "filter":
                below.errorbar(counts, [row.ratio for row in mine], [row.ratio_error for row in mine], **style)
        for row in rows:
            if row.dimension == dimension and not row.num_particles:
                above.axhline(row.error, linestyle=":", color="gray")
                below.axhline(row.ratio, linestyle=":", color="gray")
        above.set(title=f"{dimension} dimension(s)", ylabel="RMSE", xscale="log")
        below.set(xlabel="particles", ylabel="smoothed / filtered", xscale="log")
    axes[0, -1].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def parse() -> argparse.Namespace:
    """Options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="3 runs of 100 and 300 particles, to see that it works")
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--smallest", type=int, default=100, help="smallest number of particles")
    parser.add_argument("--largest", type=int, default=50_000, help="largest number of particles")
    parser.add_argument("--quadratic", type=int, default=2000, help="largest for O(N^2) smoothers other than FBS")
    parser.add_argument("--folder", type=Path, help="where the CSV and the figure go")
    return parser.parse_args()


def main() -> None:
    options = parse()
    counts = [n for n in (100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000)]
    counts = [count for count in counts if options.smallest <= count <= options.largest]
    if options.quick:
        counts, options.runs = [100, 300], 3
    rows = [row for dimension in (1, 3) for row in study(dimension, counts, options.runs, options.quadratic)]
    table = [
        [
            str(r.dimension),
            f"{r.num_particles:,}",
            r.method,
            f"{r.error:.3f} +- {r.standard_error:.3f}",
            f"{r.ratio:.3f} +- {r.ratio_error:.3f}",
        ]
        for r in rows
    ]
    show(f"Growth model, T = 100, {options.runs} runs", ["d", "N", "", "RMSE", "of the filter's"], table)
    if options.folder:
        options.folder.mkdir(parents=True, exist_ok=True)
        with (options.folder / "dimensionality.csv").open("w", newline="") as file:
            csv.writer(file).writerows([Row._fields, *rows])
        draw(rows, options.folder / "dimensionality.png")


if __name__ == "__main__":
    main()
