"""The published claims, also those of filters and smoothers on walks (sections 6 and 8): theirs, ours, and whether each holds.

Differences are shares of the error that they are compared with, and are judged by :data:`poseppl_papers.measured.MATTERS`.
Intervals are over people, each of whom is a mean of runs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from poseppl_papers.experiment import Claim, Tables, all_of, claims_by_table, on_one_recording, verdict_of
from poseppl_papers.measured import MATTERS, Interval, Measured, difference, find, mean_interval
from poseppl_papers.peursum.dimensionality import EXACT
from poseppl_papers.peursum.monocular import monocular_claims
from poseppl_papers.peursum.plan import PUBLISHED_EXPONENT
from poseppl_papers.peursum.tables import (
    ANNEALED,
    CIRCLES,
    DIFFUSIONS,
    FURNITURE,
    PLAIN,
    SMOOTHERS,
    WALK_FILTER,
    errors_by_person,
    filters_of,
    gains,
    runtime_claims,
    sweep,
    told_share,
)
from poseppl_papers.tables import Table, grouped

ALIKE = 1 + MATTERS
"""The ratio of errors up to which two filters are alike."""
HALF = 0.5
"""Share of the error that smoothing leaves at most where it pays."""
OTHER_SCENE = "none: another recording"
_PAYING, _IDLE = 500, range(500, 2000)
"""Numbers of particles at which smoothing pays in one dimension, and at which it does not in three (section 7.1)."""


def _filters(table: Table) -> list[str]:
    """The names of the plain filter, the one of more particles, and of the annealed one."""
    names = table.values("method")
    return [next(name for name in names if name.startswith(word)) for word in (PLAIN, ANNEALED)]


def _table_2(tables: Tables) -> Claim:
    table, parts = tables["trackers"], []
    for system, diffusion in DIFFUSIONS.items():
        found = [find(table, "absolute", system=system, method=method).mean for method in _filters(table)]
        parts.append(f"{' and '.join(f'{mean:.0f}' for mean in found)} mm with the {diffusion} diffusion")
    what = "Table 2: errors on HumanEva, three or four cameras"
    theirs = "Simple-PF 100 mm, Simple-APF 98 mm"
    return Claim(what, theirs, ", ".join(parts), OTHER_SCENE, "HumanEva is not at hand")


def _sharpened(tables: Tables) -> Claim:
    parts, verdicts = [], []
    for system, diffusion in DIFFUSIONS.items():
        error, share = sweep(tables, system, "absolute"), sweep(tables, system, "ess_share")
        annealed = error.pop("annealed")
        parts.append(f"{diffusion} diffusion: {_swept(error, share, annealed)}")
        verdicts.append(_by_lambda(diffusion, {name: _alike(plain, annealed) for name, plain in error.items()}))
    what = "Section 6.1: a plain filter whose likelihood is sharpened by lambda = 10 is as good as the annealed one"
    why = f"as good is at most {100 * (ALIKE - 1):.0f} % more error, by two standard errors over runs"
    return Claim(what, "alike, ESS / N 0.05 to 0.2", "; ".join(parts), "; ".join(verdicts), why)


def _swept(error: Mapping[str, Measured], share: Mapping[str, Measured], annealed: Measured) -> str:
    published = f"{PUBLISHED_EXPONENT:g}"
    first, best = published if published in error else next(iter(error)), min(error, key=lambda name: error[name].mean)
    more = {name: difference(each, annealed) for name, each in error.items()}
    rises = ", ".join(f"{rise:.0f} +- {spread:.0f} at {name}" for name, (rise, spread) in more.items())
    return (
        f"annealed {annealed.text()} mm; plain {error[first].text()} at lambda = {first} (ESS / N {share[first].mean:.2g}), "
        f"least {error[best].text()} at {best} ({share[best].mean:.1g}); more than the annealed one's {rises} (standard errors)"
    )


def _shared_out(tables: Tables) -> Claim:
    """At which lambda the effective sample size is the paper's: what its parts leaves open is how cameras share in lambda."""
    parts, verdicts = [], []
    for system, diffusion in DIFFUSIONS.items():
        share = {name: each for name, each in sweep(tables, system, "ess_share").items() if name != "annealed"}
        parts.append(f"{diffusion} diffusion: {', '.join(f'{each.mean:.2g} at {name}' for name, each in share.items())}")
        verdicts.append(_by_lambda(diffusion, {name: _between(each, *ESS_SHARES) for name, each in share.items()}))
    what = "Section 4.3: the plain filter's effective sample size, as a share of N, with lambda times the sum over four cameras"
    why = "a lambda of 10 times the mean over cameras is 2.5 here; by two standard errors over runs, to two digits"
    return Claim(what, "0.05 to 0.2", "; ".join(parts), "; ".join(verdicts), why)


def _by_lambda(diffusion: str, verdicts: Mapping[str, str]) -> str:
    """Verdicts, each with the values of lambda that it is on."""
    groups = grouped(verdicts, lambda name: on_one_recording(verdicts[name]))
    text = "; ".join(f"{verdict} at lambda = {', '.join(names)}" for verdict, names in groups.items())
    return f"with the {diffusion} diffusion {text}"


def _between(value: Measured, low: float, high: float) -> str:
    """Is a mean within bounds? By two standard errors, to two digits as the paper has them, or undecided."""
    return Interval(*(round(each, 2) for each in value.interval)).within(low, high)


def _alike(plain: Measured, annealed: Measured) -> str:
    """Is the plain filter's error above the annealed one's by more than a tenth? By two standard errors, or undecided."""
    error = math.hypot(plain.error, ALIKE * annealed.error)
    return Interval.around(plain.mean - ALIKE * annealed.mean, 2 * error).below(0)


def _seconds(tables: Tables) -> Claim:
    table = tables["trackers"]
    largest = max(table.values("evaluations"))
    spent = table.values("seconds", evaluations=largest)
    ours = f"{min(spent):.2g} to {max(spent):.2g} s, {largest:,} evaluations, four cameras"
    return Claim("Table 4: seconds a frame", "240 s (PF), 245 s (APF), three cameras", ours, "none: another machine", "")


def _dimensions(tables: Tables) -> list[Claim]:
    share = {(row["dimension"], row["particles"]): row for row in tables["dimensionality"].records()}
    found = []
    if (1, _PAYING) in share:
        ours = f"takes away {_gone(share[1, _PAYING])} of the error at {_PAYING} particles, exact {_gone(share[1, EXACT])}"
        verdict = _left(share[1, _PAYING]).below(HALF)
        theirs = f"more than 50 % less error at {_PAYING} particles"
        found.append(Claim("Section 7.1: smoothing pays in one dimension", theirs, ours, verdict, "by two standard errors"))
    idle = [size for dimension, size in share if dimension == 3 and size in _IDLE]
    if idle:
        pays = any(_left(share[3, size]).high < 1 for size in idle)
        sizes = [size for dimension, size in share if dimension == 3 and size != EXACT and size >= min(idle)]
        text = ", ".join(
            f"{_gone(share[3, n])} at {n:,} ({told_share(share[3, n])}, {share[3, n]['runs']} runs)" for n in sizes
        )
        ours = f"takes away {text}, exact {_gone(share[3, EXACT])}"
        what = "Section 7.1: in three dimensions smoothing gains nothing below 2,000 particles"
        why = "the share of the error that is left, by two standard errors"
        found.append(Claim(what, "10 % less error at 50,000", ours, verdict_of(not pays), why))
    return found


def _left(row: Mapping[str, Any]) -> Interval:
    """The share of the error that smoothing leaves, by two standard errors."""
    return Interval.around(row["share"], 2 * row["share_standard_error"])


def _gone(row: Mapping[str, Any]) -> str:
    return f"{100 * (1 - row['share']):.0f} %"


THEIRS = {
    CIRCLES: {"Simple-PF": 100.0, "Simple-APF": 98.0, "FSHHMM-PF": 94.0},
    FURNITURE: {"Simple-PF": 168.0, "Simple-APF": 185.0, "FSHHMM-PF": 110.0},
}
"""Mean errors of Table 2 on HumanEva and on CLUTTER, mm (section 6.1)."""


ESS_SHARES = (0.05, 0.2)
"""The paper's effective sample sizes as shares of N."""


LEARNED = "FSHHMM"
"""First letters of the filter with the learned motion."""


BOUND = 100 * MATTERS


_WHY = f"differences of less than {BOUND:.0f} % do not matter; 95 % interval over people"


_PAPERS = {CIRCLES: "HumanEva", FURNITURE: "CLUTTER"}


def walk_claims(tables: Tables) -> list[Claim]:
    """All claims that the table decides."""
    filters = filters_of(tables)
    learned, generic = _first(filters, LEARNED), [name for name in filters if not name.startswith(LEARNED)]
    run = [kind for kind in _PAPERS if errors_by_person(tables, learned, WALK_FILTER, kind)]
    found = [_errors(tables, kind) for kind in run]
    found += [_alike_on_walks(tables, kind, *generic[:2]) for kind in run if len(generic) > 1]
    found += [_guides(tables, learned, name) for name in generic if len(run) == len(_PAPERS)]
    found += [_smoothing(tables, filter) for filter in filters]
    found += [_lag(tables, learned)] if FURNITURE in run else []
    return [*found, _effective(tables, learned), _survivors(tables, learned), _seconds_on_walks(tables, learned)]


def _errors(tables: Tables, kind: str) -> Claim:
    parts = [
        f"{filter} {mean_interval(list(_filtered(tables, filter, kind).values())).text()}" for filter in filters_of(tables)
    ]
    theirs = ", ".join(f"{name} {error:.0f}" for name, error in THEIRS[kind].items())
    what = f"Table 2: errors of the filters, {_PAPERS[kind]}, mm"
    return Claim(what, theirs, f"{', '.join(parts)} ({kind})", "none: other recordings", "mean posture at thirteen joints")


def _alike_on_walks(tables: Tables, kind: str, plain: str, annealed: str) -> Claim:
    """Whether the annealed filter does about as well as the plain one."""
    own, other = (_filtered(tables, name, kind) for name in (annealed, plain))
    less = mean_interval([100 * (1 - own[person] / other[person]) for person in own if person in other])
    theirs = THEIRS[kind]
    published = 100 * (1 - theirs["Simple-APF"] / theirs["Simple-PF"])
    what = f"Section 6.1: the plain and the annealed filter perform similarly, {_PAPERS[kind]}"
    ours = f"{annealed} {less.text()} % less than {plain} ({kind})"
    return Claim(what, f"annealed {published:.0f} % less", ours, less.within(-BOUND, BOUND), _WHY)


def _guides(tables: Tables, learned: str, generic: str) -> Claim:
    """Whether furniture adds more to the errors of a generic motion than to those of the learned one."""
    more = {name: _added(tables, name) for name in (learned, generic)}
    people = [person for person in more[learned] if person in more[generic]]
    apart = mean_interval([more[generic][person] - more[learned][person] for person in people])
    text = ", ".join(f"{name} {mean_interval(list(own.values())).text()}" for name, own in more.items())
    published = {name: 100 * (THEIRS[FURNITURE][name] / THEIRS[CIRCLES][name] - 1) for name in THEIRS[CIRCLES]}
    theirs = f"% more: {', '.join(f'{_short(name)} {published[_short(name)]:.0f}' for name in (learned, generic))}"
    what = f"Section 6.1: clutter adds more to the error of {generic} than to that of {learned}"
    return Claim(what, theirs, f"% more: {text}; {apart.text()} apart", apart.above(BOUND), _WHY)


def _added(tables: Tables, filter: str) -> dict[str, float]:
    """How much higher the error of a filter is among furniture than on the same person's circle, %."""
    clean, full = (_filtered(tables, filter, kind) for kind in (CIRCLES, FURNITURE))
    return {person: 100 * (full[person] / clean[person] - 1) for person in clean if person in full}


def _smoothing(tables: Tables, filter: str) -> Claim:
    """Whether no smoother lowers the error over all scenes by what matters."""
    found = _gains(tables, filter, tuple(_PAPERS))
    verdict = all_of(gain.below(BOUND) for gain in found.values())
    kinds = " and ".join(kind for kind in _PAPERS if gains(tables, filter, SMOOTHERS[0], kind))
    what = f"Section 6.2: smoothing does not lower the error of {filter}"
    return Claim(what, "most results are less accurate", f"{_less(found)} ({kinds})", verdict, _WHY)


def _lag(tables: Tables, filter: str) -> Claim:
    found = _gains(tables, filter, (FURNITURE,))
    verdicts = "; ".join(f"{name} {gain.above(BOUND)}" for name, gain in found.items())
    what = "Section 6.2: smoothing helps the learned motion among furniture, at 25 frames a second, which lags behind"
    return Claim(what, "it does", _less(found), verdicts, _WHY)


def _gains(tables: Tables, filter: str, kinds: Sequence[str]) -> dict[str, Interval]:
    """How much lower the error of each smoother is than its filter's, %, over people, whose scenes count alike."""
    found: dict[str, Interval] = {}
    for name in SMOOTHERS:
        own = [gains(tables, filter, name, kind) for kind in kinds]
        people = dict.fromkeys(person for each in own for person in each)
        values = [float(np.mean([each[person] for each in own if person in each])) for person in people]
        found |= {name: mean_interval(values)} if values else {}
    return found


def _less(found: Mapping[str, Interval]) -> str:
    return f"% less: {', '.join(f'{name} {gain.text()}' for name, gain in found.items())}"


def _effective(tables: Tables, filter: str) -> Claim:
    mean, text = _over_people(tables, filter, "ess_share", ".2f")
    what = "The effective sample size of FSHHMM-PF, as a share of N"
    return Claim(what, "0.05 to 0.2", text, mean.within(*ESS_SHARES), "95 % interval over people")


def _survivors(tables: Tables, filter: str) -> Claim:
    count = float(filter.rpartition(" ")[2].replace(",", ""))
    mean, text = _over_people(tables, filter, "survivors", ".0f", count)
    what = f"Section 6.2: of {count:,.0f} particles one has descendants three frames later"
    return Claim(what, "one", text, mean.below(2), "holds below two; 95 % interval over people")


def _over_people(tables: Tables, filter: str, column: str, spec: str, factor: float = 1.0) -> tuple[Interval, str]:
    """A column of the filter's rows over people, and how it is written."""
    own = [errors_by_person(tables, filter, WALK_FILTER, kind, column) for kind in _PAPERS]
    people = dict.fromkeys(person for each in own for person in each)
    mean = mean_interval([factor * float(np.mean([each[person] for each in own if person in each])) for person in people])
    return mean, f"{mean.text(spec)}, {len(people)} people"


def _seconds_on_walks(tables: Tables, filter: str) -> Claim:
    median = float(np.median(tables["walks"].column("seconds", filter=filter, smoother=WALK_FILTER).astype(float)))
    return Claim("Table 4: seconds a frame of FSHHMM-PF", "25 s", f"{median:.2g} s, a busy core", "none: another machine", "")


def _filtered(tables: Tables, filter: str, kind: str) -> dict[str, float]:
    return errors_by_person(tables, filter, WALK_FILTER, kind)


def _short(filter: str) -> str:
    """A filter's name without its size."""
    return filter.partition(",")[0]


def _first(names: Sequence[str], start: str) -> str:
    return next(name for name in names if name.startswith(start))


claims = claims_by_table(
    {
        "walks": [walk_claims],
        "runtimes": [runtime_claims],
        "monocular": [monocular_claims],
        "trackers": [_table_2, _seconds],
        "exponents": [_sharpened, _shared_out],
        "dimensionality": [_dimensions],
    }
)
