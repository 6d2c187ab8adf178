"""Models of many fields against independent answers, for docs/validation/models.md."""

from __future__ import annotations

from collections.abc import Mapping

from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
_COLUMNS = ("model", "answer", "filter", "smoother", "filtered mean, SD", "smoothed mean, SD", "log-evidence, nats")


def independent_answers(tables: Tables) -> str:
    """A row for each model and pair of algorithms; a sentence with the worst of them."""
    rows = tables["independent_answers"].records()
    models = dict.fromkeys(row["model"] for row in rows)
    formulas = [row for row in rows if row["filter"] in ("kalman", "hidden-markov") and row["smoother"] != "laplace"]
    worst = max(max(row["filtered"], row["smoothed"]) for row in rows)
    exact = max(max(row["filtered"], row["smoothed"], abs(row["evidence"])) for row in formulas)
    said = (
        f"{len(models)} models, {len(rows)} pairs of filter and smoother. The largest error of a mean is {worst:.2g} posterior "
        f"standard deviations. The largest error of Kalman and hidden Markov filters and their smoothers is {exact:.1g}."
    )
    return f"{said}\n\n{markdown(_COLUMNS, [_cells(row) for row in rows])}"


def _cells(row: Mapping[str, object]) -> list[str]:
    numbers = [f"{float(str(row[name])):.2g}" for name in ("filtered", "smoothed", "evidence")]
    return [str(row["model"]), str(row["held_against"]), f"`{row['filter']}`", f"`{row['smoother']}`", *numbers]
