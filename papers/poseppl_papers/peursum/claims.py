"""The published claims: theirs and ours, whether each holds, and which numbers say so."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from poseppl_papers.experiment import Claim, Tables, claims_by_table, on_one_recording, verdict_of
from poseppl_papers.measured import MATTERS, Interval, Measured, difference, find
from poseppl_papers.peursum.dimensionality import EXACT
from poseppl_papers.peursum.monocular import monocular_claims
from poseppl_papers.peursum.plan import PUBLISHED_EXPONENT
from poseppl_papers.peursum.runtimes import runtime_claims
from poseppl_papers.peursum.tables import ANNEALED, DIFFUSIONS, PLAIN, sweep, told_share
from poseppl_papers.peursum.walk_claims import ESS_SHARES, walk_claims
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
