"""The likelihood's maximum in pymc-extras: a structural model from N(1000, 1e7), by PyMC's `find_MAP` with flat priors."""

import numpy as np
import pymc as pm
import pytensor.tensor as pt
from pymc_extras.statespace import structural

NAME, PACKAGE, METHOD, JOB = "pymc-extras", "pymc-extras", "structural model from a wide prior, `find_MAP`", "job_nile"


def prepare(data):
    level = structural.LevelTrend(order=1, name="level") + structural.MeasurementError(name="noise")
    model = level.build(verbose=False)
    with pm.Model(coords=model.coords) as joint:
        pm.Deterministic("P0", pt.constant([[1e7]]))
        pm.Deterministic("initial_level", pt.constant([1000.0]), dims="state_level")
        pm.Deterministic("sigma_noise", pm.math.exp(pm.Flat("log_noise") / 2))
        pm.Deterministic("sigma_level", pm.math.exp(pm.Flat("log_step", dims="shock_level") / 2))
        model.build_statespace_graph(data[:, None])

    def run(seed):
        start = {"log_noise": 9.0, "log_step": np.array([7.0])}
        found = pm.find_MAP(start=start, model=joint, progressbar=False)
        return np.exp([found["log_noise"].item(), found["log_step"].item()])

    return run
