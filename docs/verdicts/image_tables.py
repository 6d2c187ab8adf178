"""Tables of filters on rendered walks, for docs/likelihoods.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from poseppl.experiments.tables import Table, markdown
from verdicts.measured import Measured, over_runs, records

Tables = Mapping[str, Table]
DIFFUSIONS = {"peursum": "published", "peursum-measured": "measured"}
SCENES = {"walk-clean": "clean", "walk-clutter": "furniture"}
HOLDING = "(holds the first pose)"


def peursum(tables: Tables) -> str:
    """Errors of Peursum's filters in two scenes, with two diffusions."""
    rows = [
        [f"{DIFFUSIONS[row['system']]}, {SCENES[row['scene']]}", row["method"], *errors(row), f"{row['seconds']:.2g}"]
        for row in records(tables["image_runs_peursum"])
    ]
    return markdown(("diffusion, scene", "filter", "error", "relative", "best particle", "s a frame"), rows)


def sweep(tables: Tables, diffusion: str, column: str) -> dict[str, Measured]:
    """A column of the sweep over lambda, by "annealed" or lambda."""
    groups: dict[str, list[float]] = {}
    for row in records(tables["image_exponents"], diffusion=diffusion):
        name = "annealed" if row["filter"].startswith("Simple-APF") else f"{row['exponent']:g}"
        groups.setdefault(name, []).append(row[column])
    return {name: over_runs(values) for name, values in groups.items()}


def exponents(tables: Tables) -> str:
    """Errors and ESS / N of the plain filter over lambda, beside the annealed one."""
    rows = []
    for system, diffusion in DIFFUSIONS.items():
        error, relative, best, share = (
            sweep(tables, system, name) for name in ("absolute", "relative", "optimistic", "ess_share")
        )
        for name in [*sorted((each for each in error if each != "annealed"), key=float), "annealed"]:
            filter = "Simple-APF, 10 x 1,000" if name == "annealed" else f"Simple-PF, 10,000, lambda = {name}"
            ess = "" if name == "annealed" else f"{share[name].mean:.2g}"
            shown = (each[name].told() for each in (error, relative, best))
            rows.append([diffusion, filter, *shown, ess, str(error[name].runs)])
    return markdown(("diffusion", "filter", "error", "relative", "best particle", "ESS / N", "runs"), rows)


def darby(tables: Tables) -> str:
    """Errors of Darby's annealed filter with four cameras, and with one under both weights."""
    parts = []
    for title, table, system in (
        ("Eq. 8, four cameras", "image_runs_darby", "darby, Eq. 8"),
        ("Eq. 8, one camera: the standard weight", "image_runs_one_camera", "darby, Eq. 8"),
        ("Eq. 9, one camera: the modified weight", "image_runs_one_camera", "darby, Eq. 9"),
    ):
        for row in records(tables[table], system=system):
            if row["method"] != HOLDING:
                count = row["method"].split(" x ")[1]
                parts.append([title, count, *errors(row), f"{row['seconds']:.2g}", str(row["runs"])])
    return markdown(("weight", "particles a layer", "error", "relative", "best particle", "s a frame", "runs"), parts)


def du_guan(tables: Tables) -> str:
    """Errors and average sample weights of Du and Guan's filters."""
    rows = []
    for row in records(tables["image_runs_du_guan"]):
        if row["method"] != HOLDING:
            weight = Measured(row["weight"], row["weight_sd"], row["runs"]).told(3)
            shown = [row["method"], f"{row['evaluations']:,}", weight, *errors(row), f"{row['seconds']:.2g}"]
            rows.append([*shown, str(row["failed"]), str(row["runs"])])
    columns = ("filter", "evaluations", "weight", "error", "relative", "best particle", "s a frame", "frames failed", "runs")
    return markdown(columns, rows)


def errors(row: Mapping[str, Any]) -> Sequence[str]:
    """Absolute, relative and best particle's, mm."""
    return [Measured(row[name], row[f"{name}_sd"], row["runs"]).told() for name in ("absolute", "relative", "optimistic")]
