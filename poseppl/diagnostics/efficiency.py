r"""Thresholds of mixing, each derived from what it means for a result, and the gain to expect of another setting.

**ESS.** A mean of effective sample size e errs by the posterior's SD over sqrt(e), which adds 1 / e to the variance of errors.
At `ESS_LOW` the coverage of 90 % intervals falls by two points, to 88 %; at `ESS_GOOD` the error is a tenth of the SD.
`ESS_AMPLE` is the number from which R-hat and ESS are themselves reliable, 50 for each half of four chains (Vehtari et al.
2021, doi:10.1214/20-BA1221); more draws than that cost time and change no interval.

**R-hat.** It is about sqrt(1 + 1 / e), e being the ESS of half a chain by the variance between them (Vats and Knudson 2021,
doi:10.1214/20-STS812): 1.01 asks for the 50 above, `RHAT_HIGH` is e = 2.3. It is read before tau: the tau of chains that
keep to different modes says nothing of how rarely they change between them.

**tau.** By Sokal 1997 its relative error is about sqrt(20 / ESS), the whole of it at an ESS of 20
(:func:`poseppl.diagnostics.inefficiency.mixing` returns the error). The best Gaussian random walk in d coordinates has
tau = d / 0.331 (Gelman, Roberts and Gilks 1996): `TAU_BAD` is that of eight.

**Acceptance.** In many dimensions the acceptance rate is a = 2 Phi(-z), and the speed per evaluation is proportional to a z^k.
The power k is 2 for random walks (Gelman, Roberts and Gilks 1996), 2/3 for Langevin proposals (Roberts and Rosenthal 1998,
doi:10.1111/1467-9868.00123) and 1/2 for HMC with trajectories of one length (Beskos et al. 2013, doi:10.3150/12-BEJ414). The
best rates are 0.234, 0.574 and 0.651.

>>> [round(best_acceptance(kind), 3) for kind in MOVES]
[0.234, 0.574, 0.651]
>>> gain_of_step_size([0.99, 0.65, 0.1], "HMC").round(1).tolist()
[4.0, 1.0, 3.4]
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.arrays import Floats
from poseppl.diagnostics.selection import provenance_table
from poseppl.runs.contents import variable

ESS_LOW, ESS_GOOD, ESS_AMPLE = 10.0, 100.0, 400.0
RHAT_HIGH, RHAT_APART = 1.2, 2.0
"""R-hat of chains that disagree, and of chains that are in different places."""
RHAT_SHARE, RHAT_WARNING = 0.02, 0.1
"""Shares of frames and coordinates above `RHAT_HIGH` that are reported, and that are a warning."""
TAU_BAD = 25.0
GAIN_HIGH = 2.0
"""Gain of another step size from which it is advised."""
MOVES = {"random walk": 2.0, "Langevin": 2 / 3, "HMC": 0.5}
"""The exponents k."""
_WITHIN = 1e-3, 0.99
"""Acceptance rates that the formula is used for; those beyond count as these."""


def _speed(acceptance: ArrayLike, kind: str) -> Floats:
    rate = np.clip(acceptance, *_WITHIN)
    return np.asarray(rate * (-scipy.special.ndtri(rate / 2)) ** MOVES[kind])


@cache
def best_acceptance(kind: str) -> float:
    """The acceptance rate at which moves of a kind of `MOVES` are most efficient."""
    rates = np.linspace(*_WITHIN, 10_000)
    return float(rates[np.argmax(_speed(rates, kind))])


def gain_of_step_size(acceptance: ArrayLike, kind: str) -> Floats:
    """ESS per evaluation at the best step size, over that at the one with this acceptance rate.

    Args:
        acceptance: Acceptance rates, of any shape.
        kind: The kind of moves, of `MOVES`.
    """
    return np.asarray(_speed(best_acceptance(kind), kind) / _speed(acceptance, kind))


def gain_of_longer_trajectories(tau: float) -> float:
    """ESS per gradient with trajectories of HMC twice as long, over that now.

    For a Gaussian coordinate a trajectory turns the phase by an angle t: neighbouring draws have the correlation cos t, and
    tau is (1 + cos t) / (1 - cos t). Twice the angle divides tau by (2 tau / (tau - 1))^2, at twice the cost.

    >>> round(gain_of_longer_trajectories(25.0), 2)
    2.17
    """
    return 2 * (tau / (tau - 1)) ** 2


class Moves(NamedTuple):
    """The moves of a result's chains: their kind of `MOVES`, how many a frame has, and the gradients that each takes."""

    kind: str
    number: int
    gradients: float


def moves_of(tree: xr.DataTree) -> Moves:
    """Find out the moves of a result's chains: as many as chains times updates by the settings, else the draws kept."""
    settings, sizes = provenance_table(tree, "settings"), tree["posterior"].sizes
    number = int(settings.get("num_chains", sizes["chain"]) * settings.get("num_updates", sizes["draw"]))
    count = variable(tree, "sample_stats", "num_gradient")
    each = 0.0 if count is None else float(np.mean(count)) / number
    return Moves("random walk" if each == 0 else "Langevin" if each <= 1.5 else "HMC", number, each)


def disagreement(rhat: ArrayLike) -> float:
    """Share of frames and coordinates in which chains disagree, of those with an R-hat; 0 where none has one."""
    values = np.asarray(rhat)
    return float((values > RHAT_HIGH).sum() / max(np.sum(~np.isnan(values)), 1))
