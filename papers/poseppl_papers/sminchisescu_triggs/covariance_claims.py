"""Claims on covariances, clavicles and sizes (sections 1.1, 2, 3.2 and Fig. 3), and what the tables say of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from poseppl_papers.experiment import UNPUBLISHED, Claim, Tables
from poseppl_papers.measured import MATTERS, Interval, mean_interval
from poseppl_papers.sminchisescu_triggs.spectra import log_volume_ratio, spectra_of
from poseppl_papers.sminchisescu_triggs.survival import kept_seconds
from poseppl_papers.tables import Table, grouped

BODIES_ARE = {"full": "34 coordinates, clavicles", "stiff_shoulders": "30 coordinates"}
"""Difference of two bodies in the part `clavicles`."""
FACTOR = 3.0
"""Ratios within this factor of each other count as alike."""
_RATIOS = {"arm": (350.0, "8 coordinates"), "full": (2000.0, "body; theirs 32 coordinates, ours 34")}
_VOLUME = 54.0
_NINETY = 1.6449


def covariance_claims(tables: Tables) -> list[Claim]:
    """The claims that the tables at hand decide."""
    found: list[Claim] = []
    if "spectra" in tables:
        bodies = tables["spectra"].values("body")
        found += [_ratio(tables["spectra"], kind, *row) for kind, row in _RATIOS.items() if kind in bodies]
        found += [_volume(tables["spectra"])] if "full" in bodies else []
    if "clavicles" in tables:
        found += [_clavicles(tables["clavicles"], figure) for figure in ("error", "kept")]
    return found + ([_sizes(tables["sizes"]), _covered(tables["sizes"])] if "sizes" in tables else [])


def _ratio(table: Table, kind: str, published: float, what: str) -> Claim:
    sd = spectra_of(table, kind)
    ratio = Interval(*(float(np.exp(each)) for each in mean_interval(np.log(sd.max(1) / sd.min(1)))))
    ours = f"{ratio.text(',.0f')}, {len(sd)} poses"
    why = f"within a factor of {FACTOR:g}; metres and radians, no prior over time; seen as points, not as contours and flow"
    claim = f"Largest over smallest standard deviation of a mode, {what} (Fig. 3)"
    return Claim(claim, f"{published:,.0f}", ours, ratio.within(published / FACTOR, published * FACTOR), why)


def _volume(table: Table) -> Claim:
    sd = spectra_of(table, "full")
    power = mean_interval(log_volume_ratio(sd))
    what = "Section 1.1: how many times larger the search volume of uniform noise is that doubles the largest radius"
    ours = f"10^{power.mean:.0f} ({power.low:.1f} to {power.high:.1f}), {sd.shape[1]} coordinates, {len(sd)} poses"
    why = "a power of ten within 5; their spectrum has 32 coordinates and is not printed"
    return Claim(what, f"10^{_VOLUME:.0f}, 32 coordinates", ours, power.within(_VOLUME - 5, _VOLUME + 5), why)


def _clavicles(table: Table, figure: str) -> Claim:
    """Whether the body without clavicles has more error, or is kept for a shorter time."""
    length = float(table.column("length")[0])
    values = {name: _by_motion(table, name, figure) for name in BODIES_ARE.values()}
    with_them, without = values.values()
    if figure == "error":
        limit = MATTERS * float(np.mean(list(with_them.values())))
        more, spec, unit = mean_interval([without[motion] - with_them[motion] for motion in with_them]), ".1f", " mm more error"
        bound = f"a tenth of {np.mean(list(with_them.values())):.0f} mm"
    else:
        limit, bound = MATTERS * length, f"a tenth of {length:g} s"
        more, spec, unit = mean_interval([with_them[motion] - without[motion] for motion in with_them]), ".2f", " s sooner lost"
    what = (
        f"Section 3.2: without clavicles recorded motions are followed worse ({'error' if figure == 'error' else 'time kept'})"
    )
    runs = len(table.rows) // len(BODIES_ARE)
    ours = f"{more.text(spec, unit)}, {len(with_them)} stretches of recordings, {runs} runs each"
    why = f"by more than {bound}; 95 % interval over stretches"
    return Claim(what, "impossible to track reaching", ours, more.above(limit), why)


def _by_motion(table: Table, tracker: str, figure: str) -> Mapping[str, float]:
    rows = grouped(table.records(tracker=tracker), lambda row: str(row["motion"]))
    if figure == "error":
        return {motion: float(np.nanmean([row["error"] for row in own])) for motion, own in rows.items()}
    return {
        motion: float(np.mean([kept_seconds(np.array(row["lost"]), row["length"]) for row in own]))
        for motion, own in rows.items()
    }


def _sizes(table: Table) -> Claim:
    """How much of the standard person's error a picture takes away."""
    less = []
    for own in grouped(table.records(), lambda row: row["person"]).values():
        scaled = {
            name: np.array([(row[name] - row["true"]) / row["prior_sd"] for row in own]) for name in ("found", "standard")
        }
        less.append(100 * (1 - np.sqrt(np.mean(scaled["found"] ** 2) / np.mean(scaled["standard"] ** 2))))
    found = mean_interval(less)
    what = "Section 2: one picture determines proportions better than the standard humanoid does"
    ours = f"{found.text(unit=' % less error')} in units of the prior, {len(less)} people, {len(table.rows) // len(less)} sizes"
    return Claim(what, "used to initialise", ours, found.above(100 * MATTERS), "by more than 10 %; 95 % interval over people")


def _covered(table: Table) -> Claim:
    inside = [
        100 * float(np.mean([abs(row["found"] - row["true"]) < _NINETY * row["sd"] for row in own]))
        for own in grouped(table.records(), lambda row: row["person"]).values()
    ]
    found = mean_interval(inside)
    what = "Sizes from one picture: coverage of 90 % intervals"
    return Claim(what, UNPUBLISHED, f"{found.text(unit=' %')}, {len(inside)} people", found.within(80, 100), "80 to 100 %")
