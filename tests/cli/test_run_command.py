"""One's own model on one's own data: tables of three kinds, settings of a file, JSON, and messages for what does not fit."""

from __future__ import annotations

import json
import math

import jax
import numpy as np
import pytest
import xarray as xr
from poseppl_models.toys.finite_hmm import finite_hmm

import poseppl
from poseppl.cli import main
from poseppl.cli.model_runs import described, read_series
from poseppl.errors import InputError
from poseppl.files.table_reading import read_table
from poseppl.filters import hidden_markov_filter
from poseppl.runs.results import load_result, provenance

MODEL = """
import numpyro, numpyro.distributions as dist
from poseppl import StateSpaceModel

def initial(params, inputs):
    numpyro.sample("level", dist.Normal(0.0, 1.0))

def transition(params, state, inputs):
    numpyro.sample("level", dist.Normal(0.9 * state["level"] + inputs["push"], 0.5))

def observation(params, state, inputs):
    numpyro.sample("y", dist.Normal(state["level"].repeat(2), params["noise"]))

def free():
    walk = lambda params, state, inputs: numpyro.sample("level", dist.Normal(state["level"], 0.5))
    return StateSpaceModel(initial, walk, observation)

def shifted():
    return StateSpaceModel(initial, transition, observation)

def learned():
    return StateSpaceModel(initial, transition, observation, lambda: numpyro.sample("noise", dist.HalfNormal(1.0)))

def heavy(params, state, inputs):
    numpyro.sample("y", dist.StudentT(3.0, state["level"].repeat(2), params["noise"]))

def tailed():
    return StateSpaceModel(initial, transition, heavy)

model = StateSpaceModel(initial, transition, observation)
number = 7
"""
ROWS = np.random.default_rng(0).normal(size=(6, 2))
PUSH = np.array([0.0, 1.0, -1.0, 0.5, 0.0, 2.0])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.py").write_text(MODEL)
    lines = [f"{10 + t},{PUSH[t]},{a},{'' if t == 2 else b}" for t, (a, b) in enumerate(ROWS)]
    (tmp_path / "data.csv").write_text("\n".join(["frame,push,y[0],y[1]", *lines, "\n"]))
    return tmp_path


def exact_evidence() -> float:
    """Log-evidence of the Kalman filter, written out for one level seen twice."""
    mean, variance, total, noise = 0.0, 1.0, 0.0, 0.3**2
    for t, row in enumerate(ROWS):
        if t:
            mean, variance = 0.9 * mean + PUSH[t], 0.81 * variance + 0.25
        for value in row[: 1 if t == 2 else 2]:
            spread = variance + noise
            total -= 0.5 * ((value - mean) ** 2 / spread + math.log(2 * math.pi * spread))
            gain = variance / spread
            mean, variance = mean + gain * (value - mean), variance * (1 - gain)
    return total


def test_a_model_of_ones_own_is_run_smoothed_and_reported(folder, capsys):
    command = ["run", "model.py", "--data", "data.csv", "--inputs", "push", "--param", "noise=0.3", "--filter", "kalman"]
    assert main([*command, "--smooth", "rauch-tung-striebel", "--json"]) == 0
    filtered, smoothed = json.loads(capsys.readouterr().out)
    assert abs(filtered["log evidence"] - exact_evidence()) < 1e-3
    assert filtered["frames"] == 6 and filtered["verdicts"] and smoothed["smoother"] == "rauch-tung-striebel"
    tree = load_result("poseppl-data.nc")
    assert tree["posterior"]["frame"].values.tolist() == [10, 11, 12, 13, 14, 15]
    assert provenance(tree)["model"] == "model.py" and (folder / "poseppl-data.png").stat().st_size > 10_000
    assert (folder / "poseppl-data-rauch-tung-striebel.nc").exists()
    # a settings file, another name in the file, NetCDF data: the same again; the command line goes first
    xr.Dataset({"y": (("t", "k"), np.where(np.isnan(tree["observed_data/y"]), np.nan, ROWS)), "push": ("t", PUSH)}).to_netcdf(
        "data.nc", engine="h5netcdf"
    )
    (folder / "run.toml").write_text(
        'filter = "kalman"\ninputs = ["push"]\nparam = {noise = 7.0}\nseed = 3\nset = {num_particles = 50}\n'
    )
    again = ["run", "model.py:shifted", "--data", "data.nc", "--settings", "run.toml", "--param", "noise=0.3", "--json"]
    assert main(again) == 0
    (told,) = json.loads(capsys.readouterr().out)
    assert abs(told["log evidence"] - exact_evidence()) < 1e-3
    known = provenance(load_result("poseppl-data.nc"))
    assert known["seed"] == 3 and known["settings"]["num_particles"] == 50


@pytest.mark.full
def test_forecasts_are_scored_and_compared(folder, capsys):
    """Verdicts on a model that predicts its data, and on one whose noise is far too small."""
    command = ["run", "model.py", "--data", "data.csv", "--inputs", "push", "--filter", "kalman", "--hindcast", "2", "-q"]
    for name, noise in (("right", 1.0), ("sure", 0.01)):
        assert main([*command, "--param", f"noise={noise}", "-o", f"{name}.nc"]) == 0
    scores = {name: load_result(f"{name}.nc")["hindcasts"] for name in ("right", "sure")}
    assert scores["right"]["lead"].values.tolist() == [1, 2]
    assert float(scores["right"]["overall"][0]) > float(scores["sure"]["overall"][0])
    assert main(["compare", "right.nc", "sure.nc", "-o", "both.html", "-q"]) == 0
    page = (folder / "both.html").read_text()
    assert "<h2>Forecasts</h2>" in page and f"{float(scores['sure']['crps'][0, 1]):.2f}"[:3] in page
    assert main([*command[:-2], "9", "--param", "noise=1"]) == 1
    assert "horizon: 9 (expected less than the result's 6 frames)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["model.py:absent", "--data", "data.csv"], "model.py has no 'absent' (expected model)"),
        (["model.py:number", "--data", "data.csv"], "model.py:number is a int"),
        (["nowhere.py", "--data", "data.csv"], "nowhere.py: no such file"),
        (["model.py", "--data", "data.csv", "--inputs", "pull"], "no column 'pull'"),
        (["model.py", "--data", "data.csv", "--inputs", "push", "--frames", "20:30"], "--frames: there is no such row"),
        (["model.py", "--data", "bad.csv", "--inputs", "push", "--param", "noise=1"], "bad.csv, line 3, push: 'x'"),
        (["model.py", "--data", "words.csv", "--inputs", "push", "--param", "noise=1"], "words.csv, line 3, push: 'n/a'"),
        (["model.py:free", "--data", "text.csv", "--param", "noise=1"], "text.csv, line 2, y[0]: 'n/a'"),
        (["model.py:free", "--data", "dates.csv", "--param", "noise=1"], "no column 'y[0]' (expected y[0], y[1]; it has date)"),
        (["model.py", "--data", "few.csv", "--inputs", "push", "--param", "noise=1"], "few.csv: no column 'y[0]'"),
        (["model.py", "--data", "data.txt"], "data.txt: a file of the kind"),
        (["model.py", "--data", "semi.csv"], "semi.csv, line 1: its head is one column, 'push;y' (expected commas between"),
        (
            ["model.py", "--data", "twice.csv", "--inputs", "push", "--param", "noise=1"],
            "frame: 1 in row 2, after 1",
        ),
        (["model.py", "--data", "data.csv", "--param", "noise=1"], "expected --inputs NAME for each column that they read)"),
        (["model.py", "--data", "data.csv", "--inputs", "push"], "expected --param NAME=NUMBER)"),
        (["model.py:learned", "--data", "data.csv", "--inputs", "push"], "expected --param noise=NUMBER, or --fit FILE"),
        (
            ["model.py:tailed", "--data", "data.csv", "--inputs", "push", "--param", "noise=1", "--filter", "kalman"],
            "--filter kalman: The observation program has no Gaussian moments",
        ),
        (["model.py", "--data", "data.csv", "--filter", "kalmann"], "expected kalman"),
        (["model.py", "--data", "data.csv", "--settings", "code.toml"], "no option 'model' of a settings file"),
        (["model.py", "--data", "data.csv", "--settings", "wrong.toml"], "wrong.toml: no option 'filtre' of a settings file"),
    ],
)
def test_what_does_not_fit_is_said(folder, capsys, words, message):
    (folder / "bad.csv").write_text("push,y[0],y[1]\n1,2,3\nx,2,3\n")
    (folder / "words.csv").write_text("date,push\n1 May,3\n2 May,n/a\n")
    (folder / "text.csv").write_text("date,y[0],y[1]\n1 May,n/a,3\n2 May,2,n/a\n")
    (folder / "dates.csv").write_text("date\n1 May\n")
    (folder / "few.csv").write_text("push,z\n1,2\n2,3\n")
    (folder / "semi.csv").write_text("push;y\n1;2\n")
    (folder / "twice.csv").write_text("frame,push,y[0],y[1]\n0,1,2,3\n1,1,2,3\n1,1,2,3\n")
    (folder / "data.txt").write_text("push y\n")
    (folder / "code.toml").write_text('model = "other.py"\n')
    (folder / "wrong.toml").write_text('filtre = "kalman"\n')
    assert main(["run", *words]) == 1
    assert message in capsys.readouterr().err
    assert not list(folder.glob("poseppl-*"))


@pytest.mark.full
def test_dates_that_nothing_uses_are_left_out_and_those_that_something_does_are_named(folder, capsys):
    head, *rows = (folder / "data.csv").read_text().split()
    dated = [f"date,{head}", *(f"2020-01-{day:02d},{row}" for day, row in enumerate(rows, 1))]
    (folder / "dated.csv").write_text("\n".join(dated))
    table, plain = read_table("dated.csv"), read_table("data.csv")
    assert list(table.unread) == ["date"] and not table.misspelt and table.columns.keys() == plain.columns.keys()
    words = ["run", "model.py", "--data", "dated.csv", "--param", "noise=1", "--inputs"]
    assert main([*words, "push"]) == 0
    assert main([*words, "push", "--inputs", "date"]) == 1
    assert "dated.csv, line 2, date: '2020-01-01'" in capsys.readouterr().err


@pytest.mark.full
def test_what_came_of_finite_sites_is_their_probabilities():
    model = finite_hmm().compile()
    result = poseppl.infer(model, {"y": np.array([0, 1, 1])}, hidden_markov_filter, jax.random.key(0))
    told = described(poseppl.diagnose(result), [])
    last = result["summary/k_probability"].values[-1]
    assert told["last frame"]["k_probability"] == last.tolist() and sum(last) == pytest.approx(1.0)


def test_a_word_among_numbers_is_reported_where_nothing_uses_its_column(folder, capsys):
    head, first, second, *rows = (folder / "data.csv").read_text().split()
    lines = [f"rain,{head}", f"1.5,{first}", f"l.5,{second}", *(f"2,{row}" for row in rows[:-1]), f"2..,{rows[-1]}"]
    (folder / "rain.csv").write_text("\n".join(lines))
    words = ["run", "model.py", "--data", "rain.csv", "--param", "noise=1", "--inputs"]
    assert main([*words, "push", "--quiet"]) == 0
    told = capsys.readouterr().err
    assert "rain.csv, line 3, rain: 'l.5', as in 1 more rows (expected a number" in told
    assert told.count("nothing uses that column, which is left out") == 1
    assert main([*words, "push", "--inputs", "rain"]) == 1
    assert "nothing uses" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("y\n1\n\n\n2\n  \n3\n\n \n", [1, np.nan, np.nan, 2, np.nan, 3]),
        ('y\n\n1\n""\n', [np.nan, 1, np.nan]),
        ("\n\ny,z\n1,2\n\n3,4\n\n", [1, np.nan, 3]),
        ("y,z\r\r\n1,2\r\r\n3,4\r\r\n", [1, 3]),
    ],
)
def test_blank_lines_within_a_table_are_rows_without_numbers(tmp_path, text, values):
    """Those before its head and at its end are none, nor are those of doubled line ends."""
    path = tmp_path / "table.csv"
    path.write_bytes(text.encode())
    np.testing.assert_array_equal(read_table(path).columns["y"], values)


@pytest.mark.full
def test_tables_of_three_kinds_are_one(folder):
    pandas = pytest.importorskip("pandas")
    table = read_table("data.csv").columns
    pandas.DataFrame(table).to_parquet("data.parquet")
    xr.Dataset({name: ("t", values) for name, values in table.items()}).to_netcdf("data.nc", engine="h5netcdf")
    assert np.isnan(table["y[1]"][2]) and list(table) == ["frame", "push", "y[0]", "y[1]"]
    for name in ("data.parquet", "data.nc"):
        other = read_table(name).columns
        for column, values in table.items():
            np.testing.assert_array_equal(other[column], values)
    (folder / "text.parquet").write_bytes(b"no parquet")
    with pytest.raises(InputError, match="no Parquet"):
        read_table("text.parquet")
    (folder / "twice.csv").write_text("a,a\n1,2\n")
    with pytest.raises(InputError, match="line 1: its head"):
        read_table("twice.csv")


@pytest.mark.full
def test_seconds_since_1970_are_read_in_double_precision(folder, capsys):
    head, *rows = (folder / "data.csv").read_text().split()
    lines = [f"time,{head}", *(f"{1_700_000_000 + second},{row}" for second, row in enumerate(rows))]
    (folder / "timed.csv").write_text("\n".join(lines))
    _, inputs = read_series("timed.csv", ("time",), slice(None))
    np.testing.assert_array_equal(inputs["time"], 1_700_000_000 + np.arange(6.0))
    words = ["run", "model.py", "--data", "timed.csv", "--param", "noise=1", "--inputs", "push", "--inputs", "time"]
    assert main([*words, "--quiet"]) == 0
    assert "inputs['time']: numbers as large as 1700000005 are 128 apart" in capsys.readouterr().err


@pytest.mark.full
@pytest.mark.parametrize("fill", [False, True])
def test_gaps_are_reported_or_filled(folder, capsys, fill):
    """The smoother and the forecasts get the inputs of all frames, too."""
    lines = [f"{t + 40 * (t > 2)},{PUSH[t]},{a},{b}" for t, (a, b) in enumerate(ROWS)]
    (folder / "gap.csv").write_text("\n".join(["frame,push,y[0],y[1]", *lines]))
    words = ["run", "model.py", "--data", "gap.csv", "--inputs", "push", "--param", "noise=0.3", "--filter", "kalman"]
    more = ["--fill-gaps", "--hindcast", "2"] * fill
    assert main([*words, *more, "--smooth", "rauch-tung-striebel"]) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert (
        "frames 3 to 42 are missing: " + ("40 frames without data are inserted; their inputs" if fill else "one trans") in told
    )
    assert load_result("poseppl-gap-rauch-tung-striebel.nc")["posterior"].sizes["frame"] == (46 if fill else 6)
