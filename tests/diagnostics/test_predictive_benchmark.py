"""The benchmark of predictive checks keeps its runs, and judges them without the truth."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
import pytest
from poseppl_models.toys.linear_gaussian import linear_gaussian

from poseppl.runs.predictive import DataPrediction, Prediction, StatePrediction
from studies import predictive_checks as benchmark


@pytest.mark.parametrize(
    ("coverage", "kinds", "expected"),
    [
        (0.79, "none", "missed"),
        (0.79, "other", ""),
        (0.85, "prediction", ""),
        (0.9, "prediction", "accused"),
        (0.9, "none", ""),
    ],
)
def test_faults(coverage: float, kinds: str, expected: str) -> None:
    assert benchmark.fault(coverage, kinds) == expected


@pytest.mark.slow
def test_runs_that_are_kept_are_not_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = linear_gaussian(2, 1).compile()
    monkeypatch.setattr(benchmark, "TOYS", {"small": lambda: {"small": benchmark.Toy(model)}})
    monkeypatch.setattr(benchmark, "start_jax", lambda: None)
    made = []
    result_of = benchmark.toy_result
    monkeypatch.setattr(benchmark, "toy_result", lambda *run: made.append(run[2]) or result_of(*run))
    arguments = ["predictive_checks.py", "--models", "small", "--filters", "extended-kalman", "--frames", "12"]
    for seeds in ("1", "2", "2"):
        monkeypatch.setattr(sys, "argv", [*arguments, "--seeds", seeds, "--output", str(tmp_path)])
        benchmark.main()
    assert made == [0, 1]
    with (tmp_path / "predictive_checks.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["seed"] for row in rows] == ["0", "1"] and all(row["errors"] == "none" for row in rows)
    kept = sorted((tmp_path / "predictions").iterdir())
    assert len(kept) == 2
    with np.load(kept[0]) as arrays:
        told = {*DataPrediction._fields, *StatePrediction._fields} - {"transfer"}  # of filters that tell their points alone
        assert told <= set(arrays) and arrays["innovation"].shape == (12, 1)
        spread = np.abs(arrays["state_mean"] - arrays["truth"]) / arrays["state_sd"]
    assert np.mean(spread < 1.645) == pytest.approx(float(rows[0]["coverage"]), abs=0.1)


@pytest.mark.full
def test_kept_runs_are_judged_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    one, shape = np.ones(100), np.ones((100, 2))
    wide = DataPrediction(
        *(2.0 * rng.standard_normal((100, 3)) for _ in range(2)), np.ones((100, 3)), np.full((100, 3), 0.1), *[one] * 3
    )
    state = StatePrediction(0 * shape, shape, 0.05 * shape, 0.9 * shape, 0 * shape)
    posterior = {"state_mean": 0 * shape, "state_sd": shape, "ess": 1000 * one}
    key = ("Lorenz-96, noise 1", "hmc", "0", "100")

    def keep(data: DataPrediction, errors: list[str]) -> None:
        known = Prediction(data, state).by_name()
        np.savez(tmp_path / benchmark.file_of(key), **known, **posterior, errors=np.array(errors, str))

    keep(wide, ["Effective number of particles below 10"])
    again = benchmark.judged_again(tmp_path, (*key, "0.7", "1.2", "other"))
    assert again[:5] == (*key, "0.7") and float(again[5]) > 3 and again[6] == "prediction other"
    calm = wide._replace(innovation=wide.innovation / 2, chi_square_transform=rng.uniform(size=100))
    keep(calm, ["The data say so"])
    assert benchmark.judged_again(tmp_path, (*key, "0.9", "4", "prediction"))[6] == "none"
    posterior["state_sd"] = 0.8 * shape  # where data tell nothing
    keep(calm, [])
    assert benchmark.judged_again(tmp_path, (*key, "0.7", "1", "none"))[6] == "unreached"
