"""Principal components of each person's departures from its mean angles (Darby, Li and Costen 2008, section 4)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats


class PrincipalComponents(NamedTuple):
    """Principal components of L angles.

    Attributes:
        centre: Mean (L,).
        components: Eigenvectors of the eta largest eigenvalues of the covariance (L, eta), the largest entry of each positive.
        spectrum: All eigenvalues (L,), descending.
    """

    centre: Floats
    components: Floats
    spectrum: Floats


def principal_components(departures: Floats, count: int) -> PrincipalComponents:
    """Find the principal components of departures (M, L), by the singular values of what is left of them without their mean."""
    centre = departures.mean(0)
    values, vectors = np.linalg.svd(departures - centre, full_matrices=False)[1:]
    spectrum = np.zeros(departures.shape[1])
    spectrum[: len(values)] = values**2 / len(departures)
    components = vectors[:count].T
    largest = np.abs(components).argmax(0)
    signs = np.sign(components[largest, np.arange(count)])
    return PrincipalComponents(centre, components * signs, spectrum)
