"""Lessons of five papers for the choice of a method today, for docs/validation/lessons.md.

    python -m studies.verdicts.lessons

Each row is a question, what committed tables say, and advice. The command draws the page's figure from the same tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from poseppl_papers.measured import Interval, mean_interval
from poseppl_papers.peursum.tables import CIRCLES, FURNITURE, SMOOTHERS, WALK_FILTER, errors_by_person, gains
from poseppl_papers.sminchisescu_triggs.claims import seconds_longer
from poseppl_papers.sminchisescu_triggs.survival import percent_lost
from poseppl_papers.sminchisescu_triggs.trackers import PUBLISHED
from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
Row = tuple[str, str, str]
_BODIES = {"arm": 4, "lower_body": 10, "full_body": 28}
_LEARNED, _PLAIN = "FSHHMM-PF, 1,000", "Simple-PF, 1,000"
_SINGLE, _GAUSSIAN = "robust, single mode", "Gaussian, single mode"


def lessons(tables: Tables) -> str:
    """The table of questions, findings and advice."""
    rows = [
        _gradients(tables["choo-fleet-2001/speed_ups"]),
        _contest(tables["choo-fleet-2001/contest_sequences"]),
        _robust(tables["sminchisescu-triggs-2001/arm"]),
        _modes(tables),
        _annealing(tables["peursum-2010/exponents"]),
        _crossover(tables["bodytrack/estimates"]),
        _learned(tables["darby-2008/guided"]),
        _clutter(tables),
        _filters_particles(tables),
        _all_frames(tables["smoothing_pays"]),
        _de_mc(tables["du-guan-2006/sequences"]),
    ]
    return markdown(("question", "found", "advice"), rows)


def _gradients(table: Table) -> Row:
    by = {row["tracker"]: row for row in table.records(by="seconds")}
    findings = ", ".join(
        f"{by[name]['speed_up']:,.{0 if by[name]['speed_up'] > 10 else 2}f} with {n}" for name, n in _BODIES.items()
    )
    found = f"HMC needs fewer seconds than a particle filter at equal variance by a factor of {findings} coordinates"
    return "[Gradients or more particles?](../choo-fleet-2001/page.md)", found, "Use gradients from about ten coordinates on"


def _contest(table: Table) -> Row:
    by = {row["method"]: row for row in table.records(recording="walk")}
    findings = "; ".join(
        f"{name} {row['error']:.0f} ± {row['error_standard_error']:.1f} mm, coverage {100 * row['markers_in_90']:.0f} %, "
        f"{row['frames_per_second']:.0f} frames/s"
        for name, row in ((name, by[name]) for name in ("HMC, as published", "assumed density", "tempered"))
    )
    advice = "Start with the default, assumed density; check it with tempered SMC"
    return "[Which filter of a whole body in one camera?](../choo-fleet-2001/page.md)", f"{findings} (± SE)", advice


def _robust(table: Table) -> Row:
    shares = {name: _lost(table, name) for name in (_GAUSSIAN, _SINGLE)}
    findings = ", ".join(f"{name} loses {share.text(unit=' %')}" for name, share in shares.items())
    return (
        "[Gaussian or robust errors?](../sminchisescu-triggs-2001/page.md)",
        f"{findings} of 12 arms of 8 s, with a tenth of the points astray",
        "Use robust errors always; they matter more than the search",
    )


def _lost(table: Table, tracker: str) -> Interval:
    chosen = {"tracker": tracker, "rate": table.column("rate")[0]}
    return percent_lost(table.column("lost", **chosen), table.column("motion", **chosen))


def _modes(tables: Tables) -> Row:
    findings = []
    for name, scene in (("arm", "an arm"), ("reflections", "limbs along the optical axis")):
        table = tables.get(f"sminchisescu-triggs-2001/{name}")
        if table is not None and _SINGLE in table.column("tracker"):
            modes = float(np.mean(table.column("modes", tracker=PUBLISHED, rate=table.column("rate")[0])))
            longer = seconds_longer(table, PUBLISHED, _SINGLE)
            findings.append(f"{scene}: {modes:.1f} modes a frame; several modes less one: {longer.text()}")
    advice = "Look at the modes a frame first: where there is one, a robust single mode does as well"
    return "[One mode or several?](../sminchisescu-triggs-2001/page.md)", "; ".join(findings), advice


def _annealing(table: Table) -> Row:
    rows = table.records(diffusion="peursum-measured")
    plain = {row["exponent"]: [] for row in rows if str(row["filter"]).startswith("Simple-PF")}
    annealed = []
    for row in rows:
        (plain[row["exponent"]] if str(row["filter"]).startswith("Simple-PF") else annealed).append(float(row["absolute"]))
    least = min(plain, key=lambda name: float(np.mean(plain[name])))
    findings = (
        f"annealed {mean_interval(annealed).text()} mm; plain {mean_interval(plain[10]).text()} mm at lambda = 10, "
        f"least {mean_interval(plain[least]).text()} mm at {least:g} (10 runs, one walk, four cameras)"
    )
    advice = "Sharpen the likelihood or anneal; neither leaves particles that say how uncertain a pose is"
    return "[Annealing or a sharper likelihood?](../peursum-2010/page.md)", findings, advice


def _crossover(table: Table) -> Row:
    by = {row["method"]: row for row in table.records()}
    crossed, plain = by["annealed, 20 x 250, limbs crossed"], by["annealed, 20 x 250"]
    findings = (
        f"log-likelihood {crossed['mean']:.4f} ± {crossed['mean_sd']:.4f} against {plain['mean']:.4f} ± {plain['mean_sd']:.4f}"
    )
    return "[Do children inherit limbs?](../bodytrack/page.md)", f"{findings} (± SD, 10 runs)", "Use crossover where you anneal"


def _learned(table: Table) -> Row:
    findings = ", ".join(
        f"{name} {mean_interval(table.column('optimistic', system=system, method=method)).text()} mm"
        for name, system, method in (
            ("standard filter of 1,000 evaluations", "standard, two cameras", "APF, 5 x 200"),
            ("guided by 200, known person", "guided, known, two cameras", "HMM-APF, 5 x 40"),
            ("unknown person", "guided, unknown, two cameras", "HMM-APF, 5 x 40"),
        )
    )
    advice = "Learn the motion if you know what people do; a learned walk follows nothing but walks"
    return "[Is a learned motion worth it?](../darby-2008/page.md)", f"best particle, two cameras: {findings}", advice


def _clutter(tables: Tables) -> Row:
    own = _peursum(tables)
    findings = []
    for name in (_LEARNED, _PLAIN):
        clean, full = (errors_by_person(own, name, WALK_FILTER, kind) for kind in (CIRCLES, FURNITURE))
        more = mean_interval([100 * (full[person] / clean[person] - 1) for person in clean if person in full])
        findings.append(f"{name} {more.text(unit=' %')}")
    return (
        "[What hides people without notice?](../peursum-2010/page.md)",
        f"unannounced furniture adds to the error of {', to that of '.join(findings)}",
        "Use a learned motion where people disappear",
    )


def _filters_particles(tables: Tables) -> Row:
    own = _peursum(tables)
    found = {name: mean_interval(list(gains(own, _LEARNED, name, CIRCLES).values())) for name in SMOOTHERS}
    findings = ", ".join(f"{name} {gain.text(unit=' %')}" for name, gain in found.items())
    advice = "Do not smooth a body by reweighting the filter's particles"
    return (
        "[Smoothing on a filter's particles?](../peursum-2010/page.md)",
        f"takes away {findings} of the error of {_LEARNED}",
        advice,
    )


def _peursum(tables: Tables) -> Tables:
    return {"walks": tables["peursum-2010/walks"]}


def _all_frames(table: Table) -> Row:
    findings = ", ".join(f"{gain.text(unit=' %')} with {cameras}" for cameras, gain in _nuts(table).items())
    found = f"NUTS on all frames takes away {findings} cameras (points)"
    return "[Smoothing on all frames?](smoothing.md#does-smoothing-pay)", found, "Smooth on all frames where cameras are few"


def _nuts(table: Table) -> dict[int, Interval]:
    """How much lower the error of NUTS on all frames is than the filter's, %, by the number of cameras."""
    found = {}
    for cameras in sorted(table.values("cameras", seen="points")):
        rows = table.records(seen="points", cameras=cameras)
        before = {(row["walk"], row["seed"]): row["error"] for row in rows if row["method"] == "filter"}
        after = {(row["walk"], row["seed"]): row["error"] for row in rows if row["method"] == "trajectory"}
        found[int(cameras)] = mean_interval([100 * (1 - after[run] / before[run]) for run in after])
    return found


def _de_mc(table: Table) -> Row:
    rows = [row for row in table.records() if str(row["method"]).startswith("DE-MC")]
    held = {row["scene"]: row["relative"] for row in table.records(method="(holds the first pose)")}
    worse = sum(row["relative"] > held[row["scene"]] for row in rows)
    found = f"relative error above that of a tracker that holds the first pose in {worse} of {len(rows)} filters and scenes"
    return (
        "[DE-MC in one camera?](../du-guan-2006/page.md)",
        found,
        "Prefer annealing in images",
    )


def draw(tables: Tables) -> Any:
    """The page's figure: gradients by dimension, cameras and a learned motion, and smoothing."""
    from poseppl.report.picture import new_picture

    picture = new_picture(12.0, 3.6)
    left, middle, right = picture.subplots(1, 3)
    _draw_speed_ups(left, tables["choo-fleet-2001/speed_ups"])
    systems = {
        "standard": ("standard, two cameras", "APF, 5 x 200"),
        "guided, unknown": ("guided, unknown, two cameras", "HMM-APF, 5 x 40"),
        "guided, known": ("guided, known, two cameras", "HMM-APF, 5 x 40"),
    }
    guided = tables["darby-2008/guided"]
    found = {name: mean_interval(guided.column("absolute", system=s, method=m)) for name, (s, m) in systems.items()}
    _bars(middle, found, "error, two cameras, mm")
    smoothers = {f"{name}, particles": gain for name, gain in _particles(tables).items()}
    smoothers |= {f"NUTS, {cameras} cameras": gain for cameras, gain in _nuts(tables["smoothing_pays"]).items()}
    _bars(right, smoothers, "error that smoothing takes away, %")
    return picture


def _particles(tables: Tables) -> dict[str, Interval]:
    return {name: mean_interval(list(gains(_peursum(tables), _LEARNED, name, CIRCLES).values())) for name in SMOOTHERS}


def _draw_speed_ups(axis: Any, table: Table) -> None:
    for by, marker in (("seconds", "o-"), ("evaluations", "s--")):
        rows = {row["tracker"]: row for row in table.records(by=by)}
        axis.plot(list(_BODIES.values()), [rows[name]["speed_up"] for name in _BODIES], marker, label=by)
    axis.axhline(1.0, color="grey", linewidth=0.8)
    axis.set(yscale="log", xlabel="coordinates", ylabel="particle filter / HMC")
    axis.legend()


def _bars(axis: Any, found: Mapping[str, Interval], label: str) -> None:
    names: Sequence[str] = list(found)
    means = [each.mean for each in found.values()]
    reach = [[each.mean - each.low for each in found.values()], [each.high - each.mean for each in found.values()]]
    axis.barh(names, means, xerr=reach, color="#1f6f8b", ecolor="#333333")
    axis.invert_yaxis()
    axis.set(xlabel=label)


if __name__ == "__main__":
    from poseppl.report.picture import save_picture
    from studies.verdicts.pages import DOCS, read_tables

    save_picture(draw(read_tables()), DOCS / "validation" / "lessons.png")
