"""The job in pymc-extras, which has no particle smoother: the graphs of its Kalman filter and smoother."""

import numpy as np
import pytensor
import pytensor.tensor as pt
from job import DECAY, NOISE, STEP
from pymc_extras.statespace.filters import KalmanSmoother, StandardFilter

NAME, PACKAGE, METHOD = "pymc-extras", "pymc-extras", "Kalman, Rauch-Tung-Striebel"


def prepare(data):
    series = pt.tensor("data", shape=(len(data), 1))
    one, zero = np.ones((1, 1)), np.zeros(1)
    matrices = {"T": DECAY * one, "Z": one, "R": one, "H": NOISE**2 * one, "Q": STEP**2 * one}
    graph = {name: pt.as_tensor(value) for name, value in {"a0": zero, "P0": one, "c": zero, "d": zero, **matrices}.items()}
    filtered, _, _, covariances, *_ = StandardFilter().build_graph(series, **graph)
    smoothed, _ = KalmanSmoother().build_graph(graph["T"], graph["R"], graph["Q"], filtered, covariances)
    smooth = pytensor.function([series], smoothed[:, 0])
    return lambda seed: smooth(data[:, None])
