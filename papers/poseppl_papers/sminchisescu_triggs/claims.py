"""The published claims, among them those on covariances, clavicles and sizes, and what the tables say of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from poseppl_papers.experiment import UNPUBLISHED, Claim, Tables, on_one_recording
from poseppl_papers.measured import MATTERS, Interval, mean_interval
from poseppl_papers.sminchisescu_triggs.spectra import log_volume_ratio, modes_claim, spectra_of
from poseppl_papers.sminchisescu_triggs.survival import kept_seconds, percent_lost
from poseppl_papers.sminchisescu_triggs.trackers import JUMPS, OURS, OURS_LIMITED, PUBLISHED
from poseppl_papers.tables import Table, grouped

MIN_RUNS = 10
"""Runs below which there is no verdict."""
_MORE = MATTERS
"""Share of a scene by which trackers may differ and still keep the body alike."""
SCENES = {
    "arm": "arm of 8 s",
    "pivot": "pivoting body",
    "complex": "complex motions",
    "reflections": "limbs along the optical axis",
    "pictures": "rendered arm",
}
_CONSTRAINTS = ("without joint limits", "without non-penetration")
_APART = "with non-penetration"
_LOSES: Mapping[str, Mapping[str, str]] = {
    "arm": {"Gaussian, single mode": "slips at 0.5 and 2.2 s", "robust, single mode": "at 2.6 s"},
    "pivot": {
        "Gaussian, single mode": "slips at 0.3 s",
        "robust, single mode": "underestimates the turn",
        "MHT, Gaussian, unconstrained": "at 0.5 s",
        "MHT, robust": "at 0.7 s",
    },
    "complex": {
        "Gaussian, single mode": "after 0.5 s",
        "robust, single mode": "after about 1 s",
    },
    "reflections": {
        "Gaussian, single mode": "significant motion in depth is untrackable",
        "robust, single mode": "loses in-depth motions",
        "MHT, Gaussian, unconstrained, large noise": "at 0.5 s of the turn",
        "MHT, robust, large noise": "at 0.7 s of the turn",
        "CONDENSATION, large noise": "as MHT, by argument",
    },
}
_SECONDS = {"arm": 5.0, "pivot": 180.0, "complex": 180.0, "reflections": 180.0, "pictures": 5.0}


def claims(tables: Tables) -> list[Claim]:
    """The claims that the tables at hand decide."""
    found = covariance_claims(tables) + ([modes_claim(tables)] if "modes_found" in tables else [])
    for scene, name in SCENES.items():
        if scene not in tables:
            continue
        table = tables[scene]
        for tracker, theirs in _LOSES.get(scene, {}).items():
            if tracker in table.column("tracker"):
                found += [_loses(table, tracker, name, theirs), _sooner(table, tracker, name)]
        found += [_sooner(table, each, name) for each in _CONSTRAINTS if each in table.column("tracker")]
        if _APART in table.column("tracker"):
            found.append(_sooner(table, PUBLISHED, name, _APART))
        if OURS in table.column("tracker"):
            found.append(_sooner(table, PUBLISHED, name, OURS, theirs=UNPUBLISHED))
        if OURS_LIMITED in table.column("tracker"):
            own = OURS if OURS in table.column("tracker") else PUBLISHED
            found.append(_sooner(table, own, name, OURS_LIMITED, theirs=UNPUBLISHED))
        if JUMPS in table.column("tracker"):
            found.append(_sooner(table, PUBLISHED, name, JUMPS, theirs=UNPUBLISHED))
        for room in table.values("room"):
            found.append(_keeps(table, name, room))
        if f"{PUBLISHED}, twice as many" in table.column("tracker"):
            found.append(_suffices(table, scene, name))
        found.append(_seconds(table, _SECONDS[scene], name))
    return found


def _first_rate(table: Table, **where: Any) -> dict[str, Any]:
    return {"rate": table.column("rate")[0], **where}


def _judged(runs: int, decided: str) -> str:
    return decided if runs >= MIN_RUNS else f"no verdict from {runs} runs"


def _lost(table: Table, tracker: str, **where: Any) -> tuple[Interval, str, int]:
    """Percentage of the runs in which a tracker lost the body, with its text, and the number of runs."""
    chosen = _first_rate(table, tracker=tracker, **where)
    lost, length = table.column("lost", **chosen), table.column("length", **chosen)
    motions = table.column("motion", **chosen)
    share, kept = percent_lost(lost, motions), float(kept_seconds(lost, length).mean())
    return share, f"lost in {share.text(unit=' %')} of {len(lost)} runs, kept for {kept:.2f} s", len(lost)


def _loses(table: Table, tracker: str, name: str, theirs: str) -> Claim:
    share, ours, runs = _lost(table, tracker)
    what, why = f"{name}: lost by {tracker}", "more than half of the runs, or fewer"
    return Claim(what, theirs, ours, _judged(runs, share.above(50)), why)


def _keeps(table: Table, name: str, room: str) -> Claim:
    share, ours, runs = _lost(table, PUBLISHED, room=room)
    what = f"{name}, {room} room: kept to the end by {PUBLISHED} sampling"
    return Claim(what, "kept", ours, _judged(runs, share.below(50)), "fewer than half of the runs lose it, or more")


class Longer(NamedTuple):
    """Seconds that one tracker keeps the body longer than another on the same data.

    Attributes:
        seconds: Over motions; over the runs where there is one motion.
        runs: Pairs of runs.
        motions: How many.
        limit: Seconds that do not matter.
    """

    seconds: Interval
    runs: int
    motions: int
    limit: float

    @property
    def verdict(self) -> str:
        """Whether it is longer by what matters."""
        found = self.seconds.above(self.limit)
        return _judged(self.runs, found if self.motions > 1 else on_one_recording(found))

    def text(self) -> str:
        """Seconds and numbers, as the page has them."""
        motions = "1 motion" if self.motions == 1 else f"{self.motions} motions"
        return f"{self.seconds.text('.2f', ' s longer')}, {self.runs} pairs of runs on {motions}"


def seconds_longer(table: Table, one: str, other: str) -> Longer:
    """How much longer the first tracker keeps the body than the second on the same data, at the first rate."""
    kept = []
    for tracker in (one, other):
        rows = table.records(**_first_rate(table, tracker=tracker))
        kept.append({(row["motion"], row["room"], row["seed"]): min(row["lost"], row["length"]) for row in rows})
    longer = {key: kept[0][key] - kept[1][key] for key in kept[0] if key in kept[1]}
    motions = grouped(longer, lambda key: key[0])
    means = [float(np.mean([longer[key] for key in own])) for own in motions.values()]
    seconds = mean_interval(means if len(means) > 1 else list(longer.values()))
    return Longer(seconds, len(longer), len(motions), _MORE * float(table.column("length")[0]))


def _sooner(table: Table, tracker: str, name: str, other: str = PUBLISHED, theirs: str = "longer") -> Claim:
    longer = seconds_longer(table, other, tracker)
    kind = f"{other} sampling" if other == PUBLISHED else other
    what = f"{name}: {kind} keeps the body longer than {tracker}"
    why = f"by more than {longer.limit:.2g} s, a tenth of the scene; mean difference on the same points, 95 % interval"
    return Claim(what, theirs, longer.text(), longer.verdict, why)


def _suffices(table: Table, scene: str, name: str) -> Claim:
    longer = seconds_longer(table, f"{PUBLISHED}, twice as many", PUBLISHED)
    numbers = "3 modes x 3 directions" if scene == "arm" else "7 modes x 6 directions"
    why = f"less than {longer.limit:.2g} s, a tenth of the scene"
    verdict = _judged(longer.runs, longer.seconds.below(longer.limit))
    return Claim(f"{name}: {numbers} suffice", "the whole sequence", f"twice as many of both: {longer.text()}", verdict, why)


def _seconds(table: Table, published: float, name: str) -> Claim:
    seconds = table.column("seconds", **_first_rate(table, tracker=PUBLISHED))
    ours = f"{mean_interval(seconds).clipped(0).text('.2g', ' s of a processor')}, {len(seconds)} runs"
    why = "another machine than their SGI O2 of 270 MHz; points stand in for images where frames are not rendered"
    return Claim(f"{name}: seconds a frame", f"{published:g} s", ours, "measured, without a verdict", why)


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
