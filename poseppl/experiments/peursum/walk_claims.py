"""What the paper claims of smoothing on walks (sections 6 and 8), and what the table says."""

from __future__ import annotations

import numpy as np

from poseppl.experiments.experiment import FAILS, HOLDS, UNDECIDED, Claim, Tables
from poseppl.experiments.measured import mean_interval
from poseppl.experiments.peursum.claims import ESS_SHARES
from poseppl.experiments.peursum.walk_tables import (
    FILTER,
    KINDS,
    SMOOTHERS,
    errors_by_scene,
    filters_of,
    gains,
    interval,
)

THEIRS = {"circles": "Simple-PF 100 mm, Simple-APF 98 mm, FSHHMM-PF 94 mm", "furniture": "168, 185 and 110 mm"}
LEARNED = "FSHHMM"
"""First letters of the filter with the learned motion."""


def walk_claims(tables: Tables) -> list[Claim]:
    """All claims that the table decides."""
    if "walks" not in tables:
        return []
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
    told, better, worse = [], False, True
    for name in SMOOTHERS:
        values = [gain for furniture in KINDS.values() for gain in gains(tables, filter, name, furniture)]
        if values:
            _, low, high = mean_interval(values)
            better, worse = better or low > 0, worse and high < 0
            told.append(f"{name} {interval(values)}")
    verdict = FAILS if better else HOLDS if worse else UNDECIDED
    what = f"Section 6.2: smoothing does not lower the error of {filter}"
    return Claim(what, "most results are less accurate", f"mm less: {', '.join(told)}", verdict, "95 % interval over scenes")


def _lag(tables: Tables, filter: str) -> Claim:
    told, lows, highs = [], [], []
    for name in SMOOTHERS:
        values = gains(tables, filter, name, True)
        _, low, high = mean_interval(values)
        lows.append(low)
        highs.append(high)
        told.append(f"{name} {interval(values)}")
    verdict = HOLDS if min(lows) > 0 else FAILS if max(highs) < 0 else UNDECIDED
    what = "Section 6.2: smoothing helps the learned motion among furniture, at 25 frames a second, which lags behind"
    return Claim(what, "it does", f"mm less: {', '.join(told)}", verdict, "holds for all three smoothers; 95 % over scenes")


def _effective(tables: Tables, filter: str) -> Claim:
    shares = tables["walks"].column("ess_share", filter=filter, smoother=FILTER).astype(float)
    mean, low, high = mean_interval(shares)
    told = f"{mean:.2f} ({low:.2f} to {high:.2f}), {len(shares)} runs"
    inside = low >= ESS_SHARES[0] and high <= ESS_SHARES[1]
    outside = high < ESS_SHARES[0] or low > ESS_SHARES[1]
    verdict = HOLDS if inside else FAILS if outside else UNDECIDED
    return Claim("The effective sample size of FSHHMM-PF, as a share of N", "0.05 to 0.2", told, verdict, "95 % over runs")


def _survivors(tables: Tables, filter: str) -> Claim:
    count = float(filter.rpartition(" ")[2].replace(",", ""))
    shares = tables["walks"].column("survivors", filter=filter, smoother=FILTER).astype(float)
    mean, low, high = mean_interval(count * shares)
    told = f"{mean:.0f} ({low:.0f} to {high:.0f}), {len(shares)} runs"
    what = f"Section 6.2: of {count:,.0f} particles one has descendants three frames later"
    return Claim(what, "one", told, FAILS if low > 2 else HOLDS if high < 2 else UNDECIDED, "holds below two; 95 % over runs")


def _seconds(tables: Tables, filter: str) -> Claim:
    median = float(np.median(tables["walks"].column("seconds", filter=filter, smoother=FILTER).astype(float)))
    return Claim("Table 4: seconds a frame of FSHHMM-PF", "25 s", f"{median:.2g} s, a busy core", "none: another machine", "")
