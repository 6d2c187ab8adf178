"""Parameters of one's own model from one's own data: the whole command, its table, and messages for what does not fit."""

from __future__ import annotations

import json
from typing import get_args

import jax
import numpy as np
import pytest
import xarray as xr

import poseppl
from poseppl.cli import main
from poseppl.cli.model_fits import described, rows_of, worded_findings
from poseppl.cli.model_runs import load_programs
from poseppl.diagnostics.verdicts.verdict import WARNING, Remedy, Verdict
from poseppl.fitting import FitMethod
from poseppl.fitting.problem import Estimate, Problem
from poseppl.fitting.results import fit_tree
from poseppl.program.parameters import parameter_bijector
from poseppl.runs.algorithms import Algorithms

MODEL = """
import jax.numpy as jnp, numpyro, numpyro.distributions as dist
from poseppl import StateSpaceModel

def parameters():
    numpyro.sample("spread", dist.LogNormal(jnp.zeros(2), 1.0).to_event(1))
    numpyro.sample("drift", dist.Normal(0.0, 1.0))

def initial(params, inputs):
    numpyro.sample("level", dist.Normal(0.0, 1.0))

def transition(params, state, inputs):
    numpyro.sample("level", dist.Normal(0.9 * state["level"] + params["drift"] * inputs["push"], 0.5))

def observation(params, state, inputs):
    numpyro.sample("y", dist.Normal(state["level"].repeat(2), params["spread"]))

def heavy(params, state, inputs):
    numpyro.sample("y", dist.StudentT(3.0, state["level"].repeat(2), params["spread"]))

model = StateSpaceModel(initial, transition, observation, parameters)
tailed = StateSpaceModel(initial, transition, heavy, parameters)
fixed = StateSpaceModel(initial, transition, observation)
"""
PUSH = np.tile([1.0, -1.0, 0.5, 0.0, 2.0], 6)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.py").write_text(MODEL)
    rng, level, lines = np.random.default_rng(0), 0.0, ["push,y[0],y[1]"]
    for t, push in enumerate(PUSH):
        level = 0.9 * level + 0.7 * push * (t > 0) + 0.5 * rng.normal()
        a, b = level + rng.normal(size=2) * [0.3, 1.0]
        lines.append(f"{push},{a},{'' if t == 2 else b}")
    (tmp_path / "data.csv").write_text("\n".join([*lines, ""]))
    return tmp_path


def log_likelihood(spread, drift, rows):
    """By a Kalman filter of one level seen twice, written out."""
    mean, variance, total = 0.0, 1.0, 0.0
    for t, row in enumerate(rows):
        if t:
            mean, variance = 0.9 * mean + drift * PUSH[t], 0.81 * variance + 0.25
        for value, noise in zip(row, np.square(spread), strict=True):
            if np.isfinite(value):
                width = variance + noise
                total -= 0.5 * ((value - mean) ** 2 / width + np.log(2 * np.pi * width))
                mean, variance = mean + variance / width * (value - mean), variance * noise / width
    return total


@pytest.mark.full
def test_parameters_are_fitted_and_a_run_goes_on_with_them(folder, capsys):
    """The likelihood falls on every side of the estimate, by half a unit at one standard error."""
    words = ["model.py", "--data", "data.csv", "--inputs", "push"]
    assert main(["fit", *words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["filter"] == "kalman" and found["frames"] == len(PUSH) and found["verdicts"] == []
    assert list(found["parameters"]) == ["spread[0]", "spread[1]", "drift"]
    fitted = poseppl.load_fit("poseppl-data-ml.nc")
    rows = fitted["observed_data/y"].values
    point = np.array([each["estimate"] for each in found["parameters"].values()])
    peak = log_likelihood(point[:2], point[2], rows)
    assert found["log likelihood"] == pytest.approx(peak, abs=1e-6)
    covariance = fitted["unconstrained_estimate/covariance"].values
    for index in range(3):
        for sign in (-1, 1):
            away = np.append(np.log(point[:2]), point[2])
            away += sign * covariance[index] / np.sqrt(covariance[index, index])
            lower = log_likelihood(np.exp(away[:2]), away[2], rows)
            assert peak - lower == pytest.approx(0.5, abs=0.15)
    assert main(["run", *words, "--filter", "kalman", "--fit", "poseppl-data-ml.nc", "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)
    assert told["log evidence"] == pytest.approx(peak, abs=1e-3)
    assert main(["report", "poseppl-data-ml.nc"]) == 1
    assert "a fit of parameters, not a result of poseppl (expected a result; poseppl run with --fit" in capsys.readouterr().err


@pytest.mark.full
def test_a_particle_method_from_a_start_with_gaps_in_a_settings_file(folder, capsys):
    head, *rows = (folder / "data.csv").read_text().split()
    lines = [f"frame,{head}", *(f"{t + 3 * (t > 4)},{row}" for t, row in enumerate(rows))]
    (folder / "gap.csv").write_text("\n".join(lines))
    (folder / "fit.toml").write_text(
        'method = "pmmh"\ninputs = ["push"]\nset = {num_draws = 5, num_warmup = 5}\nfilter-set = {num_particles = 20}\n'
    )
    start = [
        word
        for name, value in (("spread[0]", 0.3), ("spread[1]", 1), ("drift", 0.7))
        for word in ("--start", f"{name}={value}")
    ]
    command = ["fit", "model.py", "--data", "gap.csv", "--settings", "fit.toml", *start]
    assert main([*command, "-o", "across.nc"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "frames 5 to 7 are missing: one transition leads across a gap" in told and "by --fill-gaps." in told
    assert main([*command, "-o", "filled.nc", "--fill-gaps", "--quiet"]) == 0
    assert "3 frames without data are inserted; their inputs repeat" in " ".join(capsys.readouterr().err.split())
    sizes = {name: poseppl.load_fit(name)["observed_data"].sizes["frame"] for name in ("across.nc", "filled.nc")}
    assert sizes == {"across.nc": len(PUSH), "filled.nc": len(PUSH) + 3}


def small_fit(finding=None):
    """An estimate of known numbers, without a search."""
    model = load_programs("model.py").compile({"push": np.zeros(())})
    data = model.observe({"y": np.zeros((4, 2))})
    problem = Problem(model, parameter_bijector(model), poseppl.kalman_filter, data, None, jax.random.key(0), None)
    u, covariance = np.array([0.0, np.log(2.0), 3.0]), np.diag([0.01, np.nan, 0.25])
    draws = np.linspace(-1, 1, 2001)[None, :, None] * np.array([0.1, np.nan, 0.5]) + u
    attrs = {"log_likelihood": -1.5, "wall_seconds": 0.25, "input": "data.csv", "model": "model.py"}
    return fit_tree(problem, Estimate(u, covariance, draws, attrs=attrs), "ml", [finding] if finding else [])


def test_the_table_has_estimates_errors_and_intervals(folder):
    tree = small_fit(Verdict(WARNING, "Too few steps;", (Remedy("raise {}", "max_steps"), Remedy("give another {}", "start"))))
    assert rows_of(tree) == [
        ("spread[0]", "1", "0.1", "0.9139", "1.094"),
        ("spread[1]", "2", "nan", "nan", "nan"),
        ("drift", "3", "0.5", "2.55", "3.45"),
    ]
    assert worded_findings(tree) == [("warning", "Too few steps; raise --set max_steps, or give another --start.")]
    about = described(tree, folder / "fit.nc")
    assert about["log likelihood"] == -1.5 and about["frames"] == 4 and about["seconds"] == 0.25
    assert about["parameters"]["spread[1]"] == {"estimate": pytest.approx(2.0), "SE or SD": None, "5 %": None, "95 %": None}
    json.dumps(about)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["model.py:fixed"], "MODEL: its programs have no parameters to estimate (expected StateSpaceModel(..., parameters="),
        (["model.py", "--data", "other.csv"], "other.csv: no column 'y[0]' (expected y[0], y[1]; it has push, z)"),
        (["model.py", "--method", "mle"], "'mle' is no method (expected ml)"),
        (
            ["model.py", "--set", "num_draws=3"],
            "--set num_draws=3: no setting of the method ml (expected num_starts, max_steps)",
        ),
        (["model.py", "--set", "num_starts=0"], "--set num_starts=0: expected at least 1"),
        (["model.py", "--set", "max_steps=few"], "--set max_steps=few: expected a whole number"),
        (["model.py", "--filter", "kalmann"], "'kalmann' is no filter (expected kalman"),
        (["model.py", "--filter", "particle", "--filter-set", "num_particle=5"], "no setting of the filter particle"),
        (["model.py", "--method", "particle-gibbs", "--filter", "particle"], "--filter: method 'particle-gibbs' was given one"),
        (["model.py", "--filter", "particle"], "--filter: its likelihood is no smooth function of the params"),
        (["model.py:tailed"], "--filter: no filter with an exact likelihood takes the model, as method ml needs"),
        (["model.py:tailed", "--filter", "kalman"], "--filter kalman: The observation program has no Gaussian moments"),
        (["model.py", "--start", "drift=1"], "--start: drift (expected a value of each of spread[0], spread[1], drift)"),
        (
            ["model.py", "--start", "drift=1", "--start", "spread[0]=-1", "--start", "spread[1]=1"],
            "--start: spread is [-1.  1.] (expected a value inside of its support)",
        ),
    ],
)
def test_what_does_not_fit_is_said(folder, capsys, words, message):
    (folder / "other.csv").write_text("push,z\n1,2\n2,3\n")
    data = [] if "--data" in words else ["--data", "data.csv"]
    assert main(["fit", *words, *data, "--inputs", "push"]) == 1
    assert message in capsys.readouterr().err
    assert not list(folder.glob("poseppl-*"))


def test_a_run_names_the_parameters_that_it_lacks(folder, capsys):
    run = ["run", "model.py", "--data", "data.csv", "--inputs", "push"]
    assert main([*run, "--param", "drift=1"]) == 1
    wanted = "its programs have parameters, and not drift (expected --param drift=NUMBER --param spread=NUMBER, or --fit FILE"
    assert wanted in capsys.readouterr().err
    xr.Dataset({"y": ("t", [1.0])}).to_netcdf("no.nc", engine="h5netcdf")
    assert main([*run, "--fit", "no.nc"]) == 1
    assert "no.nc: a NetCDF file, but no fit of poseppl" in capsys.readouterr().err


def test_the_methods_of_the_command_are_those_of_fit():
    assert set(Algorithms("method", "poseppl.fitting")) == set(get_args(FitMethod))
