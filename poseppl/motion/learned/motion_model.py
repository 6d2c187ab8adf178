r"""A learned activity: what Darby, Li and Costen (2008, doi:10.1109/AFGR.2008.4813348, sections 4 and 5) train.

L of a body's d coordinates are learned; the root's six and the head's three are free. The learned angles are

    epsilon ~ mean + \bar\epsilon + \Phi f   (Eq. 1),       f = \Phi^T (epsilon - mean - \bar\epsilon)   (Eq. 2),

with each person's own mean angles, or for an unknown person the average of them. The features f (eta,) are emissions of a
hidden Markov model with N states: s_t ~ A[s_(t-1)], f_t ~ N(mu_s, Sigma_s).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from poseppl.arrays import Floats, Integers
from poseppl.motion.learned.angles import wrapped

MEMORY = 0.1
"""Seconds after which what an unknown person does otherwise is another (ours): it changes within the cycle of an activity."""
_MAX_KEPT = 0.9999
"""Correlation from a frame to the next that a residual has at most, so that it is never known without an error."""


class MotionModel(NamedTuple):
    r"""A learned activity.

    Attributes:
        body: Builder of the body, by name.
        rate: Frames a second that a transition stands for.
        coordinates: Names of the body's d coordinates.
        learned: Indices of those that are learned (L,), ascending.
        persons: Names of the P persons.
        person_means: Their mean angles (P, L), radians.
        centre: Mean \bar\epsilon of what is left of the angles (L,).
        components: Phi (L, eta), orthonormal columns.
        spectrum: Variances along all principal components (L,), descending.
        initial: Probabilities of the first state (N,).
        transition: A (N, N), rows sum to one.
        means: mu (N, eta).
        covariances: Sigma (N, eta, eta).
        residual_scale: Standard deviations of the angles about the components (L,), radians.
        residual_correlation: Correlation of these from a frame to the next (L,).
        step_scale: Root mean square change of each coordinate from a frame to the next (d,), mm and radians.
        largest_step: Largest such change (d,).
        limits: Least and largest value of each coordinate (d, 2); infinite for the root's.
        log_likelihoods: Log-likelihood of the training data after each round of Baum-Welch.
        provenance: Record of its training: files, frames, settings, versions.
    """

    body: str
    rate: float
    coordinates: tuple[str, ...]
    learned: Integers
    persons: tuple[str, ...]
    person_means: Floats
    centre: Floats
    components: Floats
    spectrum: Floats
    initial: Floats
    transition: Floats
    means: Floats
    covariances: Floats
    residual_scale: Floats
    residual_correlation: Floats
    step_scale: Floats
    largest_step: Floats
    limits: Floats
    log_likelihoods: Floats
    provenance: Mapping[str, Any]

    @property
    def free(self) -> Integers:
        """Indices of the coordinates that are not learned."""
        return np.setdiff1d(np.arange(len(self.coordinates)), self.learned)

    @property
    def explained(self) -> float:
        """Fraction of the variance that the components keep."""
        return float(self.spectrum[: self.components.shape[1]].sum() / self.spectrum.sum())

    def mean_angles(self, person: str | None = None) -> Floats:
        """Mean angles (L,) of a person, with the centre; without one, those of an unknown person: the average of all.

        Raises:
            KeyError: There is no such person.
        """
        if person is not None and person not in self.persons:
            raise KeyError(person)
        own = self.person_means.mean(0) if person is None else self.person_means[self.persons.index(person)]
        return np.asarray(own + self.centre)

    def residuals(self, person: str | None = None) -> tuple[Floats, Floats]:
        """How far the angles of a person stay from :meth:`angles`, and for how long.

        For an unknown person this includes the distance of its mean from the average, as the persons' means have it. Other
        deviations last for :data:`MEMORY`.

        Returns:
            Standard deviations (L,) in radians, and correlations from a frame to the next (L,), below 1.
        """
        if person is not None:
            return self.residual_scale, np.minimum(self.residual_correlation, _MAX_KEPT)
        variance, count = self.residual_scale**2, len(self.persons)
        if count > 1:
            apart = wrapped(self.person_means - self.person_means.mean(0))
            variance = variance + np.sum(apart**2, 0) / (count - 1) * (1 + 1 / count)
        return np.sqrt(variance), np.full(len(variance), np.exp(-1 / (self.rate * MEMORY)))

    def features(self, states: ArrayLike, person: str | None = None) -> Floats:
        """Features (T, eta) of states (T, d), by Eq. 2."""
        left = wrapped(np.asarray(states, np.float64)[..., self.learned] - self.mean_angles(person))
        return np.asarray(left @ self.components)

    def angles(self, features: ArrayLike, person: str | None = None) -> Floats:
        """Learned angles (T, L) of features (T, eta), by Eq. 1."""
        return np.asarray(self.mean_angles(person) + np.asarray(features, np.float64) @ self.components.T)
