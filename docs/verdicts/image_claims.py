"""Verdicts on published claims about filters in images, for docs/likelihoods.md."""

from __future__ import annotations

import math
from collections.abc import Mapping

from poseppl.experiments.tables import Table, markdown
from verdicts.image_tables import DIFFUSIONS, HOLDING, sweep
from verdicts.measured import Measured, difference, find, records

Tables = Mapping[str, Table]
PLAIN, ANNEALED = "Simple-PF, 10,000", "Simple-APF, 10 x 1,000"
CLUTTER = {PLAIN: 168 - 100, ANNEALED: 185 - 98}
"""What clutter adds in Peursum's Table 2, mm."""
ALIKE = 1.1
"""The ratio of errors up to which two filters are alike; the paper calls 168 and 185 mm so."""


def claims(tables: Tables) -> str:
    """All rows."""
    rows = [
        _table_2(tables),
        _clutter(tables),
        _sharpened(tables),
        _seconds(tables),
        _best_particle(tables),
        *_one_camera(tables),
        _weights(tables),
        _layers(tables),
    ]
    return markdown(("claim", "here", "verdict"), rows)


def _peursum(tables: Tables, system: str, scene: str, method: str) -> Measured:
    return find(tables["image_runs_peursum"], "absolute", system=system, scene=scene, method=method)


def _table_2(tables: Tables) -> list[str]:
    told = [
        " and ".join(f"{_peursum(tables, system, 'walk-clean', method).mean:.0f}" for method in (PLAIN, ANNEALED))
        + f" mm with the {diffusion} diffusion"
        for system, diffusion in DIFFUSIONS.items()
    ]
    claim = "Peursum, Table 2: Simple-PF 100 mm and Simple-APF 98 mm on HumanEva, three or four cameras"
    return [claim, ", ".join(told), "none: other recordings"]


def _clutter(tables: Tables) -> list[str]:
    told, less = [], []
    for system, diffusion in DIFFUSIONS.items():
        rises = {
            method: difference(*(_peursum(tables, system, scene, method) for scene in ("walk-clutter", "walk-clean")))
            for method in CLUTTER
        }
        told.append(" and ".join(f"{rise:.0f} +- {error:.0f}" for rise, error in rises.values()) + f" mm ({diffusion})")
        less += [rise + 2 * error < CLUTTER[method] for method, (rise, error) in rises.items()]
    here = f"furniture adds {', '.join(told)}, with standard errors of three runs"
    verdict = "does not hold in this scene" if all(less) else "holds for some"
    return ["Table 2, clutter: 168 and 185 mm, 68 and 87 more", here, verdict]


def _sharpened(tables: Tables) -> list[str]:
    told, verdicts = [], []
    for system, diffusion in DIFFUSIONS.items():
        error, share = sweep(tables, system, "absolute"), sweep(tables, system, "ess_share")
        annealed = error.pop("annealed")
        best = min(error, key=lambda name: error[name].mean)
        judged: dict[str, list[str]] = {}
        for name in sorted(error, key=float):
            judged.setdefault(_alike(error[name], annealed), []).append(name)
        more = {name: difference(error[name], annealed) for name in sorted(error, key=float)}
        rises = ", ".join(f"{rise:.0f} +- {spread:.0f} at {name}" for name, (rise, spread) in more.items())
        told.append(
            f"{diffusion} diffusion: annealed {annealed.told()} mm; plain {error['10'].told()} at lambda = 10 (ESS / N "
            f"{share['10'].mean:.2g}), least {error[best].told()} at {best} ({share[best].mean:.1g}); more than the annealed "
            f"one's {rises} (standard errors)"
        )
        where = "; ".join(f"{verdict} at lambda = {', '.join(names)}" for verdict, names in judged.items())
        verdicts.append(f"with the {diffusion} diffusion {where}")
    claim = (
        "section 6.1: a plain filter whose likelihood is sharpened by lambda = 10 (ESS / N 0.05 to 0.2) is as good as the "
        "annealed one: at most a tenth more error"
    )
    return [claim, "; ".join(told), "; ".join(verdicts)]


def _alike(plain: Measured, annealed: Measured) -> str:
    """Is the plain filter's error above the annealed one's by more than a tenth? By two standard errors, or undecided."""
    above = plain.mean - ALIKE * annealed.mean
    error = math.hypot(plain.error, ALIKE * annealed.error)
    return "undecided" if abs(above) <= 2 * error else "does not hold" if above > 0 else "holds"


def _seconds(tables: Tables) -> list[str]:
    spent = [row["seconds"] for row in records(tables["image_runs_peursum"]) if row["evaluations"] == 10_000]
    here = f"{min(spent):.1f} to {max(spent):.1f} s, four cameras, two busy cores"
    return ["Table 4: 240 s a frame (PF), 245 s (APF), three cameras", here, "none: other machines"]


def _best_particle(tables: Tables) -> list[str]:
    best = find(tables["image_runs_darby"], "optimistic", method="APF, 5 x 1,000")
    claim = "Darby, after Balan (2005): the best of an annealed filter's 1,000 particles is off by 41 mm, three cameras"
    return [claim, f"{best.told()} mm, four cameras at 30 Hz instead of 60", "none: other recordings"]


def _one_camera(tables: Tables) -> list[list[str]]:
    table = tables["image_runs_one_camera"]
    holding = records(table, system="darby, Eq. 8", method=HOLDING)[0]["relative"]
    found = {
        system: [find(table, name, system=system, method="APF, 5 x 1,000") for name in ("absolute", "relative")]
        for system in ("darby, Eq. 8", "darby, Eq. 9")
    }
    error, relative = found["darby, Eq. 8"]
    fails = relative.mean - 2 * relative.error > holding
    modified, posed = found["darby, Eq. 9"]
    gain, uncertain = difference(error, modified)
    still = posed.mean - 2 * posed.error > holding
    return [
        [
            "the same: with one camera the standard annealed filter fails",
            f"{error.told()} mm with the standard weight (Eq. 8); relative to the pelvis {relative.told()}, where a tracker "
            f"that holds the first pose has {holding:.0f}",
            "holds" if fails else "does not hold",
        ],
        [
            "Darby, section 6.1: the modified weight (Eq. 9) keeps the place of the body better",
            f"{modified.told()} mm, {gain:.0f} +- {uncertain:.0f} less; relative to the pelvis {posed.told()}, "
            f"{'still above' if still else 'not above'} the held pose's",
            "holds" if gain > 2 * uncertain else "does not hold",
        ],
    ]


def _weights(tables: Tables) -> list[str]:
    table = tables["image_runs_du_guan"]
    weight = {row["method"]: Measured(row["weight"], row["weight_sd"], row["runs"]) for row in records(table)}
    error = {row["method"]: Measured(row["absolute"], row["absolute_sd"], row["runs"]) for row in records(table)}
    plain, annealed, *ours = (
        next(name for name in weight if name.startswith(start))
        for start in ("CONDENSATION", "APF", "DE-MC (velocity), 7", "DE-MC (transition), 7")
    )
    told = " and ".join(f"{weight[name].mean:.3f}" for name in ours)
    far = " and ".join(error[name].told() for name in ours)
    here = (
        f"weights {told} (prediction by velocity; by the random walk) against {weight[plain].mean:.3f} (CONDENSATION) and "
        f"{weight[annealed].mean:.3f} (annealed); errors {far} mm against {error[plain].told()} and {error[annealed].told()}"
    )
    rivals = max(weight[plain].mean, weight[annealed].mean)
    holds = all(weight[name].mean > rivals for name in ours)
    some = any(weight[name].mean > weight[plain].mean for name in ours)
    verdict = "holds" if holds else "holds against CONDENSATION alone" if some else "does not hold"
    claim = (
        "Du and Guan, Fig. 4: with 70 % of the evaluations DE-MC of 7 layers has more average weight than CONDENSATION and the "
        "annealed filter"
    )
    return [claim, here, verdict]


def _layers(tables: Tables) -> list[str]:
    told, fewer = [], []
    for prediction in ("velocity", "transition"):
        rows = [row for row in records(tables["image_runs_du_guan"]) if row["method"].startswith(f"DE-MC ({prediction})")]
        told.append(", ".join(f"{row['weight']:.3f}" for row in rows) + f" ({prediction})")
        fewer.append([row["weight"] for row in rows] == sorted((row["weight"] for row in rows), reverse=True))
    order = "; fewer layers have more weight here" if all(fewer) else "; no order here either"
    return ["Fig. 5: 2, 5 and 7 layers compared", f"weights {'; '.join(told)}", f"none: the text tells no order{order}"]
