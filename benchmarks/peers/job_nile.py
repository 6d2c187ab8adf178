"""The job of a likelihood's maximum: both variances of a local level of the Nile's flow, from a diffuse start.

The exact answer is of SciPy's optimiser on the diffuse likelihood of a plain loop (Durbin and Koopman 2012, section 2.10,
publish 15099 and 1469.1), and the units of errors are the standard errors that its curvature gives.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

FLOW = np.array(
    [1120, 1160, 963, 1210, 1160, 1160, 813, 1230, 1370, 1140, 995, 935, 1110, 994, 1020, 960, 1180, 799, 958, 1140]
    + [1100, 1210, 1150, 1250, 1260, 1220, 1030, 1100, 774, 840, 874, 694, 940, 833, 701, 916, 692, 1020, 1050, 969]
    + [831, 726, 456, 824, 702, 1120, 1100, 832, 764, 821, 768, 845, 864, 862, 698, 845, 744, 796, 1040, 759]
    + [781, 865, 845, 944, 984, 897, 822, 1010, 771, 676, 649, 846, 812, 742, 801, 1040, 860, 874, 848, 890]
    + [744, 749, 838, 1050, 918, 986, 797, 923, 975, 815, 1020, 906, 901, 1170, 912, 746, 919, 718, 714, 740.0]
)
"""Annual flow at Aswan, 1871 to 1970, 10^8 m^3."""


def draw() -> np.ndarray:
    """Data (T,)."""
    return FLOW


def log_likelihood(log_variances: np.ndarray, data: np.ndarray) -> float:
    """Log-likelihood of the logarithms of the variances of noise and step; the first datum fixes the level."""
    noise, step = np.exp(log_variances)
    mean, variance, total = data[0], noise, -0.5 * np.log(2 * np.pi)
    for datum in data[1:]:
        variance += step
        width = variance + noise
        total -= 0.5 * (np.log(2 * np.pi * width) + (datum - mean) ** 2 / width)
        mean += variance / width * (datum - mean)
        variance *= noise / width
    return float(total)


def exact(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variances (2,), and their standard errors."""
    found = minimize(lambda u: -log_likelihood(u, data), np.log([1e4, 1e3]), tol=1e-10).x
    steps = 1e-3 * np.eye(2)
    curvature = [
        [sum(i * j * log_likelihood(found + i * a + j * b, data) for i in (1, -1) for j in (1, -1)) / 4e-6 for a in steps]
        for b in steps
    ]
    return np.exp(found), np.exp(found) * np.sqrt(np.diag(np.linalg.inv(-np.array(curvature))))
