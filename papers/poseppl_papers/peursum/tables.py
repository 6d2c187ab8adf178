"""Tables and figures of the experiment, of its walks and their run times (Table 4), and how its page tells them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np

from poseppl.report.picture import new_picture
from poseppl_papers.experiment import Claim, Jobs, Pictures, Results, Tables
from poseppl_papers.images.tables import COLOURS, filter_rows, told_errors
from poseppl_papers.images.tracking import FIGURES, Tracking
from poseppl_papers.measured import Measured, mean_interval, over_runs
from poseppl_papers.peursum.dimensionality import EXACT, FILTER
from poseppl_papers.peursum.mixtures import DEFAULT, PUBLISHED
from poseppl_papers.peursum.plan import BURN_IN_FRAMES, PUBLISHED_EXPONENT
from poseppl_papers.peursum.smoothed_walks import ALGORITHMS, STAGES
from poseppl_papers.runs import joined
from poseppl_papers.tables import Table, grouped, markdown, rows_of

DIFFUSIONS = {"peursum": "published", "peursum-measured": "measured"}
PLAIN, ANNEALED = "Simple-PF", "Simple-APF"
"""First words of both filters' names."""


def exponent_table(jobs: Sequence[Tracking], results: Results) -> Table:
    """One row a run, without the frame where it starts; the annealed filter has no exponent."""
    columns = ("diffusion", "scene", "frames", "filter", "exponent", "run", *FIGURES, "ess_share", "seconds")
    rows: list[tuple[Any, ...]] = []
    for job in jobs:
        exponent = dict(job.system.settings).get("exponent", PUBLISHED_EXPONENT)
        text = "" if job.method.name.startswith(ANNEALED) else f"{exponent:g}"
        found = {name: values[:, 1:] for name, values in joined([job], results).items() if values.ndim > 1}
        for index, run in enumerate(job.runs):
            errors = [float(value) for value in found["errors"][index].mean(0)]
            cost = float(found["ess_share"][index].mean()), float(np.median(found["seconds"][index]))
            rows.append((job.system.name, job.scene.name, job.num_frames, job.method.name, text, run, *errors, *cost))
    about = "Plain filter over lambda and annealed filter, one row a run: errors in mm, mean ESS / N, seconds a frame (median)."
    return Table("exponents", columns, rows, about)


def trackers(tables: Tables) -> str:
    """Errors of the filters, with two diffusions."""
    rows = [
        [DIFFUSIONS[row["system"]], row["method"], *told_errors(row), f"{row['seconds']:.2g}", str(row["runs"])]
        for row in filter_rows(tables, "trackers")
    ]
    columns = ("diffusion", "filter", "error", "relative", "best particle", "s a frame", "runs")
    return markdown(columns, rows)


def sweep(tables: Tables, diffusion: str, column: str) -> dict[str, Measured]:
    """A column of the sweep over lambda, by "annealed" or lambda, the least first."""

    def name_of(row: Mapping[str, Any]) -> str:
        return "annealed" if row["filter"].startswith(ANNEALED) else f"{float(row['exponent']):g}"

    groups = grouped(rows_of(tables, "exponents", diffusion=diffusion), name_of)
    order = sorted(groups, key=lambda name: float("inf") if name == "annealed" else float(name))
    return {name: over_runs([row[column] for row in groups[name]]) for name in order}


def exponents(tables: Tables) -> str:
    """Errors and ESS / N of the plain filter over lambda, beside the annealed one."""
    names = {row["filter"].startswith(ANNEALED): row["filter"] for row in rows_of(tables, "exponents")}
    rows = []
    for system, diffusion in DIFFUSIONS.items():
        columns = [sweep(tables, system, name) for name in ("absolute", "relative", "optimistic", "ess_share")]
        for name in columns[0]:
            filter = names[True] if name == "annealed" else f"{names[False]}, lambda = {name}"
            ess = "" if name == "annealed" else f"{columns[3][name].mean:.2g}"
            shown = (each[name].text() for each in columns[:3])
            rows.append([diffusion, filter, *shown, ess, str(columns[0][name].runs)])
    return markdown(("diffusion", "filter", "error", "relative", "best particle", "ESS / N", "runs"), rows)


def dimensionality(tables: Tables) -> str:
    """Errors of the smoother as a share of the filter's."""
    if "dimensionality" not in tables:
        return ""
    share = {(row["dimension"], row["particles"]): row for row in tables["dimensionality"].records()}
    counts = sorted({size for _, size in share if size != EXACT})
    rows = [
        [f"d = {d}", *(told_share(share[d, size]) if (d, size) in share else "" for size in (*counts, EXACT))] for d in (1, 3)
    ]
    return markdown(("N", *(f"{count:,}" for count in counts), EXACT), rows)


def told_share(row: dict[str, Any]) -> str:
    """A share, with its standard error where it has one."""
    value, error = row["share"], row["share_standard_error"]
    return f"{value:.3f}" if np.isnan(error) else f"{value:.3f} ± {error:.3f}"


def mixtures(tables: Tables) -> str:
    """Cost of a mixture in place of the likelihood."""
    if "mixtures" not in tables:
        return ""
    rows = tables["mixtures"].records()
    error = {row["smoother"]: row["error"] for row in rows}
    shown = [[row["smoother"], f"{row['error']:.2f}", f"{row['variance']:.2f}"] for row in rows]
    times = error[PUBLISHED] / error[DEFAULT]
    text = f"The mixture that is not divided makes the smoothed means {times:.1f} times as wrong as the one that is."
    return f"{markdown(('smoother', 'error', 'variance'), shown)}\n\n{text}"


def draw_exponents(tables: Tables, jobs: Jobs, results: Results) -> Pictures:
    """Error of the plain filter over lambda, with its standard deviation over runs; a band is the annealed filter's."""
    picture = new_picture(5.5, 4.0)
    axis = picture.subplots()
    for colour, (system, diffusion) in zip(COLOURS, DIFFUSIONS.items(), strict=False):
        error = sweep(tables, system, "absolute")
        annealed = error.pop("annealed")
        sharpness = [float(name) for name in error]
        mean, spread = [each.mean for each in error.values()], [each.spread for each in error.values()]
        axis.errorbar(sharpness, mean, spread, fmt="o-", color=colour, capsize=3, label=f"plain, {diffusion} diffusion")
        axis.axhline(annealed.mean, color=colour, linestyle="--", label=f"annealed, {diffusion} diffusion")
        band = annealed.mean - annealed.spread, annealed.mean + annealed.spread
        axis.axhspan(*band, color=colour, alpha=0.15, linewidth=0)
    axis.set(xscale="log", xlabel="lambda", ylabel="mean's error, mm")
    axis.legend(fontsize=8)
    return {"exponents.png": picture}


def draw_dimensionality(tables: Tables, jobs: Jobs, results: Results) -> Pictures:
    """Fig. 14: errors above, ratios to the filter below; one column a dimension, dotted lines for the exact means."""
    table = tables["smoothers"]
    dimensions = sorted({row[0] for row in table.rows})
    picture = new_picture(5.0 * len(dimensions), 7.0)
    axes = picture.subplots(2, len(dimensions), squeeze=False)
    for column, dimension in enumerate(dimensions):
        for axis, figure in zip(axes[:, column], ("error", "share"), strict=True):
            _curves(axis, table, dimension, figure)
        axes[0, column].set(title=f"{dimension}-dimensional", ylabel="RMSE")
        axes[1, column].set(xlabel="particles", ylabel="smoothed / filtered")
    axes[0, -1].legend(fontsize=8)
    return {"dimensionality.png": picture}


def _curves(axis: Any, table: Table, dimension: int, figure: str) -> None:
    rows = table.records(dimension=dimension)
    error = "standard_error" if figure == "error" else "share_standard_error"
    for number, method in enumerate(dict.fromkeys(row["method"] for row in rows if row["particles"] != EXACT)):
        mine = [row for row in rows if row["method"] == method and row["particles"] != EXACT]
        values = ([row[name] for row in mine] for name in ("particles", figure, error))
        if not (figure == "share" and method == FILTER):
            axis.errorbar(*values, color=COLOURS[number], label=method, capsize=3)
    for row in rows:
        if row["particles"] == EXACT:
            axis.axhline(row[figure], linestyle=":", color="gray")
    axis.set(xscale="log")


WALK_COLUMNS = ("scene", "frames", "filter", "smoother", "run", "error", "seconds", "ess_share", "survivors")
WALK_FILTER, SMOOTHERS = ALGORITHMS[0], ALGORITHMS[1:]
CIRCLES, FURNITURE, ANNOUNCED = KINDS = ("circles", "furniture", "announced furniture")
"""Scenes: without furniture, among furniture as the paper has it, and where trackers are given its pixels."""
_ABOUT_WALKS = (
    "Error of the mean posture at thirteen joints (mm), mean over frames from the sixth on; seconds a frame, those of a filter "
    "without compilation; shares of particles that are effective, and that have descendants three frames later."
)


def walk_table(jobs: Jobs, results: Results) -> list[Table]:
    """One row a scene, filter, smoother and run; seconds of smoothers are NaN in a job's first run, which compiles them."""
    rows: list[tuple[Any, ...]] = []
    for job in jobs["walks"]:
        found = results[job.key]
        for index, run in enumerate(job.runs):
            shares = float(found["ess_share"][index]), float(found["survivors"][index])
            for number, name in enumerate(ALGORITHMS[: found["errors"].shape[1]]):
                error = float(found["errors"][index, number, BURN_IN_FRAMES:].mean())
                seconds = float(found["seconds"][index, number]) if index or name == WALK_FILTER else np.nan
                rows.append((job.scene.name, job.num_frames, job.method.name, name, run, error, seconds, *shares))
    return [Table("walks", WALK_COLUMNS, rows, _ABOUT_WALKS)]


def kind_of(scene: str) -> str:
    """One of :data:`KINDS`, from a scene's name."""
    place = scene.partition("-")[2]
    if not place.startswith("clutter"):
        return CIRCLES
    return FURNITURE if place.endswith("unannounced") else ANNOUNCED


def errors_by_person(tables: Tables, filter: str, smoother: str, kind: str, column: str = "error") -> dict[str, float]:
    """Mean error over runs (mm), or another column, of a filter and a smoother on each person's walk of a kind."""
    rows = [row for row in tables["walks"].records(filter=filter, smoother=smoother) if kind_of(row["scene"]) == kind]
    found = grouped(rows, lambda row: row["scene"].partition("-")[0])
    return {person: float(np.mean([row[column] for row in own])) for person, own in found.items()}


def filters_of(tables: Tables) -> list[str]:
    """Names of the filters, in the order of the table."""
    return tables["walks"].values("filter")


def gains(tables: Tables, filter: str, smoother: str, kind: str) -> dict[str, float]:
    """Difference of a filter's and its smoother's error, % of the filter's, by person; empty if it was not run."""
    own, before = (errors_by_person(tables, filter, name, kind) for name in (smoother, WALK_FILTER))
    return {person: 100 * (1 - own[person] / before[person]) for person in own if np.isfinite(own[person])}


def walks(tables: Tables) -> str:
    """Mean errors of all algorithms on all kinds of scenes, and what smoothers take away."""
    if "walks" not in tables:
        return ""
    rows = []
    for filter in filters_of(tables):
        for name in ALGORITHMS:
            cells = [_told(tables, filter, name, kind) for kind in (CIRCLES, FURNITURE)]
            seconds = tables["walks"].column("seconds", filter=filter, smoother=name).astype(float)
            cost = f"{np.nanmedian(seconds):.2g}" if np.isfinite(seconds).any() else ""
            known = _told(tables, filter, name, ANNOUNCED)[0] if name == WALK_FILTER else ""
            rows.append([filter, name, *(each for pair in cells for each in pair), known, cost])
    columns = ("filter", "smoother", *(f"{kind}: {what}" for kind in (CIRCLES, FURNITURE) for what in ("error", "less, %")))
    return markdown((*columns, f"{ANNOUNCED}: error", "s a frame"), rows)


def _told(tables: Tables, filter: str, name: str, kind: str) -> tuple[str, str]:
    errors = list(errors_by_person(tables, filter, name, kind).values())
    if not errors or not np.isfinite(errors).all():
        return "", ""
    less = "" if name == WALK_FILTER else mean_interval(list(gains(tables, filter, name, kind).values())).text()
    return mean_interval(errors).text(), less


RUNTIME_COLUMNS = ("scene", "frames", "filter", "stage", "run", "seconds")
HUMANEVA, CLUTTER = "circle", "furniture"
THEIRS: Mapping[str, Mapping[str, tuple[float, ...]]] = {
    HUMANEVA: {
        "Simple-PF": (240, 138, 30, 40, 200),
        "Simple-APF": (245, 140, 14, 15, 93),
        "FSHHMM-PF": (25, 0.8, 0.5, 1.4, 1.7),
    },
    CLUTTER: {
        "Simple-PF": (95, 133, 30, 34, 108),
        "Simple-APF": (98, 134, 15, 12, 88),
        "FSHHMM-PF": (10, 0.8, 0.4, 0.8, 1.5),
    },
}
"""Table 4 by :data:`STAGES`, seconds a frame."""
_ABOUT_RUNTIMES = "Seconds a frame on a core that others use, too; the mixture apart from the smoothers that stand on it."


def runtime_table(jobs: Jobs, results: Results) -> list[Table]:
    """One row a scene, filter, stage and run, without each job's first run, which compiles."""
    rows: list[tuple[Any, ...]] = []
    for job in jobs["runtimes"]:
        found = np.asarray(results[job.key]["stages"], float)
        for index, run in list(enumerate(job.runs))[1:]:
            for stage, seconds in zip(STAGES, found[index].tolist(), strict=True):
                rows.append((job.scene.name, job.num_frames, job.method.name, stage, run, seconds))
    return [Table("runtimes", RUNTIME_COLUMNS, rows, _ABOUT_RUNTIMES)]


def runtimes(tables: Tables) -> str:
    """Ours and, in brackets, theirs."""
    if "runtimes" not in tables:
        return ""
    rows = []
    for (kind, filter), seconds in _medians(tables["runtimes"]).items():
        theirs = THEIRS[kind][filter.partition(",")[0]]
        shown = [f"{seconds[stage]:.2g} ({value:g})" for stage, value in zip(STAGES, theirs, strict=True)]
        rows.append([kind, filter, *shown])
    return markdown(("scene", "filter", "filtering", *STAGES[1:]), rows)


def runtime_claims(tables: Tables) -> list[Claim]:
    """The share of the time that smoothing adds to filtering, which says little of the machine."""
    own = {filter: seconds for (kind, filter), seconds in _medians(tables["runtimes"]).items() if kind == HUMANEVA}
    if not own:
        return []
    published = {filter: dict(zip(STAGES, THEIRS[HUMANEVA][filter.partition(",")[0]], strict=True)) for filter in own}
    theirs, ours = ("; ".join(f"{name} {_added(seconds)}" for name, seconds in each.items()) for each in (published, own))
    what = "Table 4: time of FBS, variational and Gibbs smoothing in percent of the filter's"
    why = "circle; the mixture counts for the last two"
    return [Claim(what, theirs, ours, "none: another machine", why)]


def _added(seconds: Mapping[str, float]) -> str:
    parts = [seconds["FBS"], *(seconds["mixture"] + seconds[name] for name in STAGES[3:])]
    return ", ".join(f"{100 * part / seconds['filter']:.0f}" for part in parts)


def _medians(table: Table) -> dict[tuple[str, str], dict[str, float]]:
    """Seconds a frame by kind of scene and filter, and then by stage."""
    found: dict[tuple[str, str], dict[str, float]] = {}
    for (scene, filter, stage), rows in grouped(table.records(), itemgetter("scene", "filter", "stage")).items():
        kind = HUMANEVA if kind_of(scene) == CIRCLES else CLUTTER
        found.setdefault((kind, filter), {})[stage] = float(np.median([row["seconds"] for row in rows]))
    return found
