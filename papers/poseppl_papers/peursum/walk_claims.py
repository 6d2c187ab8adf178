"""The paper's claims about filters and smoothers on walks (sections 6 and 8), and our table's.

Differences are shares of the error that they are compared with, and are judged by :data:`poseppl_papers.measured.MATTERS`.
Intervals are over people, each of whom is a mean of runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from poseppl_papers.experiment import Claim, Tables, all_of
from poseppl_papers.measured import MATTERS, Interval, mean_interval
from poseppl_papers.peursum.walk_tables import (
    CIRCLES,
    FILTER,
    FURNITURE,
    SMOOTHERS,
    errors_by_person,
    filters_of,
    gains,
)

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
    run = [kind for kind in _PAPERS if errors_by_person(tables, learned, FILTER, kind)]
    found = [_errors(tables, kind) for kind in run]
    found += [_alike(tables, kind, *generic[:2]) for kind in run if len(generic) > 1]
    found += [_guides(tables, learned, name) for name in generic if len(run) == len(_PAPERS)]
    found += [_smoothing(tables, filter) for filter in filters]
    found += [_lag(tables, learned)] if FURNITURE in run else []
    return [*found, _effective(tables, learned), _survivors(tables, learned), _seconds(tables, learned)]


def _errors(tables: Tables, kind: str) -> Claim:
    parts = [
        f"{filter} {mean_interval(list(_filtered(tables, filter, kind).values())).text()}" for filter in filters_of(tables)
    ]
    theirs = ", ".join(f"{name} {error:.0f}" for name, error in THEIRS[kind].items())
    what = f"Table 2: errors of the filters, {_PAPERS[kind]}, mm"
    return Claim(what, theirs, f"{', '.join(parts)} ({kind})", "none: other recordings", "mean posture at thirteen joints")


def _alike(tables: Tables, kind: str, plain: str, annealed: str) -> Claim:
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
    own = [errors_by_person(tables, filter, FILTER, kind, column) for kind in _PAPERS]
    people = dict.fromkeys(person for each in own for person in each)
    mean = mean_interval([factor * float(np.mean([each[person] for each in own if person in each])) for person in people])
    return mean, f"{mean.text(spec)}, {len(people)} people"


def _seconds(tables: Tables, filter: str) -> Claim:
    median = float(np.median(tables["walks"].column("seconds", filter=filter, smoother=FILTER).astype(float)))
    return Claim("Table 4: seconds a frame of FSHHMM-PF", "25 s", f"{median:.2g} s, a busy core", "none: another machine", "")


def _filtered(tables: Tables, filter: str, kind: str) -> dict[str, float]:
    return errors_by_person(tables, filter, FILTER, kind)


def _short(filter: str) -> str:
    """A filter's name without its size."""
    return filter.partition(",")[0]


def _first(names: Sequence[str], start: str) -> str:
    return next(name for name in names if name.startswith(start))
