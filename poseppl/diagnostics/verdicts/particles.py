"""Degeneracy of weighted particles."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.verdicts.verdict import ERROR, ESS_LOW, WARNING, Verdict, settings_among, statistic, where
from poseppl.runs.results import is_weighted, provenance

LOW_SHARE = 0.1
"""Of the frames with few effective particles, above which they are an error: a filter finds back from single ones."""


def degeneracy(tree: xr.DataTree) -> list[Verdict]:
    """Degeneracy of weighted particles."""
    known = provenance(tree)
    if not is_weighted(tree) or known.get("closed form"):  # whose weights are exact, however few there are
        return []
    number, more = int(tree.attrs["num_particles"]), settings_among(tree, "num_particles")
    found = []
    effective = statistic(tree, "ess")
    if effective is not None:
        low = effective < ESS_LOW
        if low.any():
            worst = f"{np.nanmin(effective):.1f}"
            text = f"Effective number of particles below {ESS_LOW:.0f} of {number} in {where(tree, low)} (least {worst})"
            suited = known.get("suited filters") or []
            others = [f"use --filter {name}" for name in suited if name != known.get("filter")][:1]
            advice = f"the particles miss the posterior; {', or '.join([f'raise {more}', *others])}"
            found.append(Verdict(ERROR if low.mean() > LOW_SHARE else WARNING, f"{text}: {advice}."))
    unique = statistic(tree, "unique_ancestors")
    if unique is not None:
        few = unique < min(ESS_LOW, number)
        few[0] = False  # no resampling comes before the first frame
        if few.any():
            text = f"Fewer than {ESS_LOW:.0f} particles have descendants in {where(tree, few)} (least {unique[few].min():.0f})"
            found.append(Verdict(WARNING, f"{text}: the sample is impoverished; raise {more}."))
    return found
