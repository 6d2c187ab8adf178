"""Filters, smoothers and samplers on known models, and what they say of claims and goals, for docs/measurements.md."""

from __future__ import annotations

import math
from collections.abc import Mapping

from poseppl.experiments.tables import Table, markdown
from verdicts.measured import records

Tables = Mapping[str, Table]
RATE, TIMES = 30.0, 5.0
"""Goals: frames a second at the settings of Choo and Fleet, and draws a second over NumPyro's NUTS."""
_NEAR = 20.0
"""Percent by which the share of a basin may be off."""
_DIVIDED = "Gibbs, components divided by the prediction (the default)"
_HOLDS = {True: "holds", False: "does not hold"}


def filters(tables: Tables) -> str:
    """Frames a second, and the goal at the paper's settings."""
    rows = records(tables["filters"])
    shown = [[row["method"], _number(row["frames_per_second"]), f"{row['compilation']:.0f} s"] for row in rows]
    reached = "was reached" if rows[0]["frames_per_second"] >= RATE else "was not reached"
    goal = f"The goal of {RATE:.0f} frames a second at the paper's setting {reached} on the loaded machine."
    return f"{markdown(('', 'frames a second', 'compilation'), shown)}\n\n{goal}"


def mueller(tables: Tables) -> str:
    """Shares of the basins, and what Du and Guan say of DE-MC."""
    rows = {row["method"]: [row[name] for name in "abc"] for row in records(tables["mueller"])}
    shown = [[name, ", ".join(_number(value) for value in values)] for name, values in rows.items()]
    exact, found = rows["quadrature"], rows["DE-MC"]
    holds = all(abs(one - other) <= _NEAR for one, other in zip(found, exact, strict=True))
    best = max(
        (name for name in rows if name not in ("quadrature", "tempered SMC, from a broad normal")), key=lambda n: rows[n][0]
    )
    verdict = (
        f"Du and Guan write that 30 iterations sample the surface well: {_HOLDS[holds]} at this "
        f"temperature (theirs is not stated), where {found[0]:.0f} % are in A instead of {exact[0]:.0f} %; of the methods that "
        f"start in one basin, {best} has most there."
    )
    return f"{markdown(('method', 'share in A, B, C (%)'), shown)}\n\n{verdict}"


def dimensionality(tables: Tables) -> str:
    """Does smoothing pay? Errors of the smoother over the filter's, and Peursum's claims of section 7.1."""
    table = tables["dimensionality"]
    share = {(row["dimension"], row["particles"]): row for row in records(table)}
    counts = [100, 200, 500, 1000, 2000]
    shown = [
        [f"d = {d}", *(_share(share[d, n]["share"], share[d, n]["share_standard_error"]) for n in [*counts, "exact"])]
        for d in (1, 3)
    ]
    gone = {key: f"{100 * (1 - row['share']):.0f} %" for key, row in share.items()}
    pays = any(row["share"] + 2 * row["share_standard_error"] < 1 for row in (share[3, 500], share[3, 1000]))
    more = share[3, 5000]
    verdicts = [
        f"- In one dimension smoothing pays: {_HOLDS[share[1, 200]['share'] < 0.5]}. {gone[1, 200]} of the error go at 200 "
        f"particles, where the exact smoother takes away {gone[1, 'exact']}.",
        f"- In three dimensions it gains nothing below 2,000 particles: {_HOLDS[not pays]}. It takes away {gone[3, 500]} of "
        f"the error at 500 particles, {gone[3, 1000]} at 1,000 and {gone[3, 2000]} at 2,000, the exact smoother "
        f"{gone[3, 'exact']}; with 5,000 particles the ratio is {_share(more['share'], more['share_standard_error'])} "
        f"({more['runs']} runs).",
    ]
    header = ("N", *(f"{count:,}" for count in counts), "exact")
    return "\n\n".join([markdown(header, shown), "\n".join(verdicts)])


def mixtures(tables: Tables) -> str:
    """What a mixture in place of the likelihood costs."""
    rows = records(tables["likelihood_mixtures"])
    shown = [[row["smoother"], f"{row['error']:.2f}", f"{row['variance']:.2f}"] for row in rows]
    error = {row["smoother"]: row["error"] for row in rows}
    ratio = error["Gibbs, the mixture of the paper, not divided"] / error[_DIVIDED]
    told = f"The mixture that is not divided makes the smoothed means {ratio:.1f} times as wrong as the one that is."
    return f"{markdown(('smoother', 'error', 'variance'), shown)}\n\n{told}"


def trajectory(tables: Tables) -> str:
    """Effective draws a second beside NumPyro's NUTS, and the goal."""
    rows = records(tables["trajectory"])
    shown = [
        [
            f"{row['frames']}{' (`--quick`)' if row['frames'] == 5 else ''}",
            *(_pair(row[f"{name}worst"], row[f"{name}median"]) for name in ("", "numpyro_", "ratio_")),
        ]
        for row in rows
    ]
    reached = [min(row["ratio_worst"], row["ratio_median"]) >= TIMES for row in rows]
    told = [f"{row['frames']} frames: {'' if each else 'not '}reached" for row, each in zip(rows, reached, strict=True)]
    goal = f"The goal of {TIMES:.0f} times as many effective draws a second, by processor time: {'; '.join(told)}."
    return f"{markdown(('frames', 'poseppl, worst; median coordinate', 'NumPyro', 'ratio'), shown)}\n\n{goal}"


def _share(value: float, error: float) -> str:
    return f"{value:.3f}" if math.isnan(error) else f"{value:.3f} ± {error:.3f}"


def _pair(one: float, other: float) -> str:
    return "" if math.isnan(one) else f"{_number(one)}; {_number(other)}"


def _number(value: float) -> str:
    return f"{value:.3g}"
