"""What the paper claims of smoothing on walks (sections 6 and 8), and what the table says."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from poseppl_papers.experiment import Claim, Tables, verdict_of
from poseppl_papers.measured import Interval, mean_interval
from poseppl_papers.peursum.walk_tables import (
    FILTER,
    KINDS,
    SMOOTHERS,
    errors_by_scene,
    filters_of,
    gains,
)

THEIRS = {"circles": "Simple-PF 100 mm, Simple-APF 98 mm, FSHHMM-PF 94 mm", "furniture": "168, 185 and 110 mm"}
ESS_SHARES = (0.05, 0.2)
"""The paper's effective sample sizes as shares of N."""
LEARNED = "FSHHMM"
"""First letters of the filter with the learned motion."""


def walk_claims(tables: Tables) -> list[Claim]:
    """All claims that the table decides."""
    learned = next(name for name in filters_of(tables) if name.startswith(LEARNED))
    run = [kind for kind, furniture in KINDS.items() if errors_by_scene(tables, learned, FILTER, furniture)]
    found = [_errors(tables, kind) for kind in run]
    found += [_smoothing(tables, filter) for filter in filters_of(tables)]
    found += [_lag(tables, learned)] if "furniture" in run else []
    return [*found, _effective(tables, learned), _survivors(tables, learned), _seconds(tables, learned)]


def _errors(tables: Tables, kind: str) -> Claim:
    told = []
    for filter in filters_of(tables):
        errors = list(errors_by_scene(tables, filter, FILTER, KINDS[kind]).values())
        told.append(f"{filter} {np.mean(errors):.0f} mm")
    what = f"Table 2: errors of the filters, {'HumanEva' if kind == 'circles' else 'CLUTTER'}"
    return Claim(what, THEIRS[kind], f"{', '.join(told)} ({kind})", "none: other recordings", "mean posture at thirteen joints")


def _smoothing(tables: Tables, filter: str) -> Claim:
    """Whether some smoother lowers the error over all scenes."""
    found = _gains(tables, filter, KINDS.values())
    better = any(gain.low > 0 for gain in found.values())
    verdict = verdict_of(not better and all(gain.high < 0 for gain in found.values()), better)
    what = f"Section 6.2: smoothing does not lower the error of {filter}"
    return Claim(what, "most results are less accurate", _less(found), verdict, "95 % interval over scenes")


def _lag(tables: Tables, filter: str) -> Claim:
    found = _gains(tables, filter, [True])
    verdict = verdict_of(all(gain.low > 0 for gain in found.values()), all(gain.high < 0 for gain in found.values()))
    what = "Section 6.2: smoothing helps the learned motion among furniture, at 25 frames a second, which lags behind"
    return Claim(what, "it does", _less(found), verdict, "holds for all three smoothers; 95 % over scenes")


def _gains(tables: Tables, filter: str, kinds: Iterable[bool]) -> dict[str, Interval]:
    """How much lower the error of each smoother is than its filter's, mm, over the scenes of some kinds."""
    found = {name: [gain for kind in kinds for gain in gains(tables, filter, name, kind)] for name in SMOOTHERS}
    return {name: mean_interval(values) for name, values in found.items() if values}


def _less(found: Mapping[str, Interval]) -> str:
    return f"mm less: {', '.join(f'{name} {gain.told()}' for name, gain in found.items())}"


def _effective(tables: Tables, filter: str) -> Claim:
    shares = tables["walks"].column("ess_share", filter=filter, smoother=FILTER).astype(float)
    mean = mean_interval(shares)
    told, verdict = f"{mean.told('.2f')}, {len(shares)} runs", mean.within(*ESS_SHARES)
    return Claim("The effective sample size of FSHHMM-PF, as a share of N", "0.05 to 0.2", told, verdict, "95 % over runs")


def _survivors(tables: Tables, filter: str) -> Claim:
    count = float(filter.rpartition(" ")[2].replace(",", ""))
    shares = tables["walks"].column("survivors", filter=filter, smoother=FILTER).astype(float)
    mean = mean_interval(count * shares)
    told = f"{mean.told()}, {len(shares)} runs"
    what = f"Section 6.2: of {count:,.0f} particles one has descendants three frames later"
    return Claim(what, "one", told, mean.below(2), "holds below two; 95 % over runs")


def _seconds(tables: Tables, filter: str) -> Claim:
    median = float(np.median(tables["walks"].column("seconds", filter=filter, smoother=FILTER).astype(float)))
    return Claim("Table 4: seconds a frame of FSHHMM-PF", "25 s", f"{median:.2g} s, a busy core", "none: another machine", "")
