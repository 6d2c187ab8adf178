"""The tables of a factored-state hierarchical hidden Markov model: learned from one recorded walk.

Peursum, Venkatesh and West (2010, doi:10.1007/s11263-009-0205-5, section 3.3); :mod:`poseppl_models.bodies.factored_motion`
makes programs of them, and tells what each means.

Peursum, Venkatesh and West (2010, section 5.2) train on "a person taking four steps in a straight line", 50 frames a second,
and leave the method to another paper. It is derived here, with nothing to iterate:

* *Phases.* A walk is periodic: its period L is the lag at which poses are most alike. Phase m is the m-th of M equal parts of a
  period, so that each frame's phase is known, and C and phi are its counts.
* *Rotations.* Counts of one walk know one walk only. A person who walks so has rotations that stay from it by residuals of
  standard deviation psi, which a frame keeps by a factor rho. With the pairs i_t -> j_t of frames in phase m

      A_m(j | i) ~ sum_t N(i - i_t; 0, psi^2) N(j - j_t - rho (i - i_t); 0, psi^2 (1 - rho^2)),
      A_m(j)     ~ sum_t N(j - j_t; 0, psi^2),

  so that psi -> 0 are the counts. A bin that lies more than 2.5 psi from all i_t has no successor: there the rotation ends.

psi and rho are ours. Angles are compared on the circle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats, Integers
from poseppl.errors import InputError
from poseppl.motion.learned.angles import wrapped

NUM_BINS = 120
"""Number of cells of a turn: 3 degrees each."""
STAYS = 0.5
"""w, ours."""
ROOT = ("tx", "ty", "tz", "Z")
"""Axes of the root's position and heading."""
_LEAST = 1e-6
"""Probability that the first frame's bins share outside of what was recorded, so that any start is possible."""


class FactoredTables(NamedTuple):
    """Probabilities of M phases, D rotations and B bins, a frame of the recording after the other.

    Attributes:
        first_phase: phi (M,), Eq. 7d.
        first_bins: varphi (M, D, B), Eq. 7e.
        phases: C (M, M), Eq. 7a; rows are the phase before.
        entries: A of a rotation that enters a phase (M, D, B), Eq. 7c.
        steps: A of one that goes on (M, D, B, B), Eq. 7b, rows the bin before; a row of zeros where the phase knows no
            successor of the bin.
        velocities: m (M, 3), mean velocity: forwards, to the left and up, mm/s.
        stays: w (), the probability that the position does not follow the heading.
    """

    first_phase: Array
    first_bins: Array
    phases: Array
    entries: Array
    steps: Array
    velocities: Array
    stays: Any = STAYS

    def successors(self, phase: Array, bins: Array) -> Array:
        """Probabilities (D, B) of the next bins, in a phase and after bins (D,): Eqs. 7b, 7c and 26."""
        rows = self.steps[phase, jnp.arange(self.steps.shape[1]), bins]
        ends = jnp.sum(rows, -1, keepdims=True) <= 0
        return jnp.where(ends, self.entries[phase], rows)

    def starting_from(self, angles: Array, scale: Array) -> FactoredTables:
        """The tables of somebody whose first rotations (D,) are known within standard deviations (D,), radians."""
        bins = self.first_bins.shape[-1]
        variance = jnp.square(scale) + (2 * jnp.pi / bins) ** 2 / 12  # of the angles within a bin
        apart = jnp.angle(jnp.exp(1j * (bin_angles(jnp.arange(bins), bins) - angles[:, None])))
        log_joint = jnp.log(self.first_bins + _LEAST / bins) - 0.5 * jnp.square(apart) / variance[:, None]
        log_phase = jnp.log(self.first_phase) + jnp.sum(jax.nn.logsumexp(log_joint, -1), -1)
        return self._replace(first_phase=jax.nn.softmax(log_phase), first_bins=jax.nn.softmax(log_joint))


def bin_angles(bins: Any, num_bins: int = NUM_BINS) -> Array:
    """Middles of bins, radians from -pi to pi."""
    return (jnp.asarray(bins) + 0.5) * (2 * jnp.pi / num_bins) - jnp.pi


def bins_of(angles: Any, num_bins: int = NUM_BINS) -> Any:
    """Bins of angles, radians."""
    turns = np.asarray(angles) / (2 * np.pi) + 0.5
    return np.floor((turns - np.floor(turns)) * num_bins).astype(int) % num_bins


def root_places(coordinates: Sequence[tuple[str, str]]) -> list[int]:
    """Indices of the root's x, y and z and of its turn about the vertical."""
    root = coordinates[0][0]
    return [list(coordinates).index((root, axis)) for axis in ROOT]


NUM_PHASES = 8
SPREAD = np.radians(6.0)
"""psi, radians."""
MEMORY = 0.2
"""Seconds in which a residual is lost, by a factor of e."""
_REACH = 2.5
"""Spreads within which a frame of the recording has a say."""
_PERIODS = (0.7, 1.7)
"""Shortest and longest period (two steps) of a walk, seconds."""


def train_factored_motion(
    poses: Floats,
    coordinates: Sequence[tuple[str, str]],
    rate: float,
    *,
    num_phases: int = NUM_PHASES,
    num_bins: int = NUM_BINS,
    spread: float = SPREAD,
    memory: float = MEMORY,
) -> FactoredTables:
    """Learn the tables.

    Args:
        poses: Poses of one person who walks straight on (T, d), mm and radians; at least two periods.
        coordinates: Joint and axis of each of the d coordinates.
        rate: Frames a second, of the poses and of the tables; velocities do not depend on it.
        num_phases: M.
        num_bins: B, of a turn.
        spread: psi, radians.
        memory: Seconds in which a residual is lost, by a factor of e: rho = exp(-1 / (rate memory)).

    Raises:
        InputError: Fewer frames than two periods.
    """
    places = root_places(coordinates)
    angles = np.delete(poses, places, axis=1)
    phases = phases_of(angles, rate, num_phases)
    kept = float(np.exp(-1.0 / (rate * memory)))
    centres = np.asarray(bin_angles(np.arange(num_bins), num_bins), np.float64)
    entries, steps = [], []
    for phase in range(num_phases):
        chosen = np.flatnonzero(phases[1:] == phase)
        before, after = angles[chosen], angles[chosen + 1]
        entries.append(_entries(after, centres, spread))
        steps.append(np.stack([_steps(*pair, centres, spread, kept) for pair in zip(before.T, after.T, strict=True)]))
    first = np.bincount(phases, minlength=num_phases) / len(phases)
    tables = first, np.stack(entries), _changes(phases, num_phases), np.stack(entries), np.stack(steps)
    velocities = rate * _strides(poses[:, places], phases, num_phases)
    return FactoredTables(*(jnp.asarray(table, float) for table in (*tables, velocities)))


def phases_of(angles: Floats, rate: float, num_phases: int) -> Integers:
    """Phase (T,) of each frame of rotations (T, D), the first frame's being 0.

    Raises:
        InputError: Fewer frames than two periods.
    """
    lags = np.arange(int(_PERIODS[0] * rate), int(_PERIODS[1] * rate) + 1)
    lags = lags[2 * lags <= len(angles)]
    if not len(lags):
        expected = f"two periods of a walk, at least {2 * _PERIODS[0]:g} s"
        raise InputError(f"{len(angles)} frames at {rate:g} Hz", field="poses", expected=expected)
    apart = [np.mean(np.square(wrapped(angles[lag:] - angles[:-lag]))) for lag in lags]
    period = int(lags[int(np.argmin(apart))])
    return np.asarray(num_phases * (np.arange(len(angles)) % period) // period)


def _entries(angles: Floats, centres: Floats, spread: float) -> Floats:
    """Shares (D, B) of bins near angles (P, D)."""
    return _normalised(_normal(wrapped(centres - angles[..., None]), spread).sum(0))


def _steps(before: Floats, after: Floats, centres: Floats, spread: float, kept: float) -> Floats:
    """Shares (B, B) of the bins that follow each bin, from pairs (P,) of one rotation."""
    apart = wrapped(centres - before[:, None])
    says = np.where(np.abs(apart) <= _REACH * spread, _normal(apart, spread), 0.0)
    means = after[:, None] + kept * apart
    follows = _normal(wrapped(centres - means[..., None]), spread * np.sqrt(1 - kept**2))
    return _normalised(np.einsum("pi,pij->ij", says, _normalised(follows)))


def _changes(phases: Integers, num_phases: int) -> Floats:
    counts = np.zeros((num_phases, num_phases))
    np.add.at(counts, (phases[:-1], phases[1:]), 1.0)
    return _normalised(counts)


def _strides(roots: Floats, phases: Integers, num_phases: int) -> Floats:
    """Mean steps (M, 3) forwards, to the left and up, of roots (T, 4)."""
    own = own_steps(roots)
    return np.stack([own[phases[1:] == phase].mean(0) for phase in range(num_phases)])


def own_steps(roots: Floats) -> Floats:
    """Steps (T - 1, 3) forwards, to the left and up, of roots (T, 4): x, y, z, turn."""
    step, turn = np.diff(roots[:, :3], axis=0), roots[1:, 3]
    sine, cosine = np.sin(turn), np.cos(turn)
    return np.stack([-sine * step[:, 0] + cosine * step[:, 1], -cosine * step[:, 0] - sine * step[:, 1], step[:, 2]], 1)


def _normal(offset: Floats, scale: float) -> Floats:
    return np.asarray(np.exp(-0.5 * np.square(offset / scale)))


def _normalised(rows: Floats) -> Floats:
    """Rows that sum to one, or are zeros."""
    total = rows.sum(-1, keepdims=True)
    return np.asarray(np.divide(rows, total, out=np.zeros_like(rows), where=total > 0))
