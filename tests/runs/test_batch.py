"""Many series in one call: each as if it had been filtered alone."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from law_problems import problem
from oracles.kalman import kalman_filter, simulate

import poseppl
from poseppl.errors import InputError
from poseppl.runs import batch as batch_module
from poseppl.runs.results import load_result, save_result
from poseppl.runs.run import Constant

POSED = problem()
SERIES, FRAMES = 7, 6
KEY = jax.random.key(0)
INPUTS = np.random.default_rng(0).normal(size=(SERIES, FRAMES, 1))
DATA = np.stack([simulate(POSED.matrices, FRAMES, seed, INPUTS[seed])[1] for seed in range(SERIES)])
DATA[2, 3] = np.nan
LENGTHS = np.array([6, 4, 6, 1, 5, 6, 6])


def exact(series: int):
    ys = DATA[series, : LENGTHS[series]]
    return kalman_filter(POSED.matrices, np.nan_to_num(ys), np.isfinite(ys), INPUTS[series])


@pytest.fixture(scope="module")
def batch():
    kalman = poseppl.kalman_filter(POSED.model, num_particles=200)
    return poseppl.infer_batch(
        POSED.model, {"y": DATA}, kalman, KEY, INPUTS, lengths=LENGTHS, chunk=3, names=[f"s{i}" for i in range(SERIES)]
    )


def test_each_series_has_its_own_evidence(batch):
    """The evidence of a Kalman filter draws nothing; chunks of three leave one series over."""
    for series in range(SERIES):
        found = batch["sample_stats/log_evidence"].sel(series=f"s{series}").values
        np.testing.assert_allclose(found[: LENGTHS[series]], exact(series).log_evidence, rtol=2e-4, atol=1e-4)
        assert np.isnan(found[LENGTHS[series] :]).all()
        # those of another series are others
        other = exact((series + 1) % SERIES).log_evidence
        assert abs(found[0] - other[0]) > 1e-3


@pytest.mark.parametrize("what", ["diagnose", "verdicts", "report", "compare"])
def test_what_is_of_one_series_says_so(batch, what, tmp_path):
    call = {"report": lambda tree: poseppl.write_report(tree, tmp_path / "report.html")}
    call["compare"] = lambda tree: poseppl.compare({"one": tree, "two": tree})
    with pytest.raises(ValueError, match=r"one of many series. Take one of them, poseppl.one_series"):
        call.get(what, getattr(poseppl, what, None))(batch)


def test_no_more_series_are_filtered_than_there_are(monkeypatch):
    """Seven in parts of at most five are two parts of four, one of them with one series twice; three are one part."""
    sizes, program = [], batch_module._series_program

    def counted(*given):
        return lambda keys, *rows: sizes.append(len(keys)) or program(*given)(keys, *rows)

    monkeypatch.setattr(batch_module, "_series_program", counted)
    kalman = poseppl.kalman_filter(POSED.model, num_particles=20)
    for number, chunk in ((SERIES, 5), (3, 100)):
        found = poseppl.infer_batch(POSED.model, {"y": DATA[:number]}, kalman, KEY, INPUTS[:number], chunk=chunk)
        assert found["summary"].sizes["series"] == number
    assert sizes == [4, 4, 3]


def test_series_that_fail_are_reported(caplog):
    data, inputs = DATA[:3].copy(), INPUTS[:3].copy()
    data[1, 4], inputs[2, 3:] = 1e30, np.nan
    lengths, kalman = [6, 6, 5], poseppl.kalman_filter(POSED.model, num_particles=200)
    found = poseppl.infer_batch(POSED.model, {"y": data}, kalman, KEY, inputs, lengths=lengths, chunk=3, names=["a", "b", "c"])
    told = [message for message in caplog.messages if "series" in message]
    assert len(told) == 2 and all(message.startswith("1 of 3 series, such as") for message in told)
    assert "'b' at frame 4: the data are impossible" in told[0] and "'c' at frame 3: the filter's state" in told[1]
    failed = found["sample_stats/failed"].values
    assert failed[1].tolist() == [False] * 4 + [True, False] and failed[2, :5].tolist() == [False] * 3 + [True] * 2


@pytest.mark.full
def test_series_have_the_layout_of_a_result(batch, tmp_path):
    assert batch["posterior/x"].dims[:4] == ("chain", "draw", "series", "frame")
    assert batch["posterior/x"].shape == (1, 20, SERIES, FRAMES, 2)
    assert batch["summary/x_quantile"].dims[:3] == ("series", "frame", "quantile")
    save_result(batch, tmp_path / "batch.nc")
    one = poseppl.one_series(load_result(tmp_path / "batch.nc"), "s1")
    assert one["posterior/x"].shape == (1, 20, 4, 2) and np.isfinite(one["posterior/x"]).all()
    ahead = poseppl.forecast(one, POSED.model, 2, KEY, INPUTS[1, 4:])
    assert ahead["forecast"]["frame"].values.tolist() == [4, 5]
    spread = one["summary/x_sd"].values
    variances = np.diagonal(exact(1).covariances, axis1=1, axis2=2)
    assert (abs(spread**2 / variances - 1) < 5 * np.sqrt(2 / 200)).all()


def test_many_series_are_not_taken_for_one(batch):
    for use in (
        lambda: poseppl.forecast(batch, POSED.model, 2, KEY),
        lambda: poseppl.smooth(batch, poseppl.forward_backward_smoother(POSED.model), KEY),
        lambda: poseppl.add_predictive(batch, POSED.model, KEY),
    ):
        with pytest.raises(ValueError, match="one of many series. Take one of them, poseppl.one_series"):
            use()


def test_a_list_of_series_is_padded(batch):
    ragged = [{"y": DATA[i, :length]} for i, length in enumerate(LENGTHS)]
    inputs = [INPUTS[i, :length] for i, length in enumerate(LENGTHS)]
    kalman = poseppl.kalman_filter(POSED.model, num_particles=200)
    found = poseppl.infer_batch(POSED.model, ragged, kalman, KEY, inputs, chunk=3)
    np.testing.assert_array_equal(found["sample_stats/num_frames"], LENGTHS)
    np.testing.assert_allclose(found["sample_stats/log_evidence"], batch["sample_stats/log_evidence"], rtol=1e-5)


@pytest.mark.full
def test_particles_of_equal_series_are_independent_and_unbiased():
    """Sixty copies of one series: their evidence is right on average, and differs from copy to copy."""
    copies, inputs = 60, np.ones((FRAMES, 1))
    _, one = simulate(POSED.matrices, FRAMES, 3, inputs)
    particles, ys = poseppl.particle_filter(POSED.model, 200), np.repeat(one[None], copies, 0)
    whole = poseppl.infer_batch(POSED.model, {"y": ys}, particles, KEY, Constant(np.ones(1)), chunk=60)
    found = whole["sample_stats/log_evidence"].sum("frame").values
    true = kalman_filter(POSED.matrices, one, inputs=inputs).log_evidence.sum()
    ratios = np.exp(found - true)
    assert len(np.unique(found)) == copies
    assert abs(ratios.mean() - 1) < 5 * ratios.std(ddof=1) / np.sqrt(copies)
    assert ratios.std(ddof=1) < 1.0  # else any mean would do


def test_what_does_not_fit_is_said():
    build = poseppl.kalman_filter
    with pytest.raises(InputError, match="data: data of shapes"):
        poseppl.infer_batch(POSED.model, {"y": np.zeros(3)}, build, KEY)
    with pytest.raises(InputError, match="lengths: lengths of shape .*7 numbers from 1 to 6"):
        poseppl.infer_batch(POSED.model, {"y": DATA}, build, KEY, INPUTS, lengths=[1, 2])
    with pytest.raises(InputError, match="inputs: an array of shape .*Constant"):
        poseppl.infer_batch(POSED.model, {"y": DATA}, build, KEY, np.zeros((SERIES, 1)))
    for names in (["a", "b"], ["a"] * SERIES):
        with pytest.raises(InputError, match="names: . different names .expected 7, one for each series"):
            poseppl.infer_batch(POSED.model, {"y": DATA}, build, KEY, INPUTS, names=names)
    with pytest.raises(InputError, match="lengths: given beside a list of series"):
        poseppl.infer_batch(POSED.model, [{"y": DATA[0]}], build, KEY, lengths=[4])
    with pytest.raises(InputError, match="inputs: series 0 has none .expected .* inputs=None"):
        poseppl.infer_batch(POSED.model, {"y": DATA}, build, KEY, [None] * SERIES)
    with pytest.raises(InputError, match="no series"):
        poseppl.infer_batch(POSED.model, [], build, KEY)


@pytest.mark.parametrize(
    ("series", "match"),
    [
        ([{"y": DATA[0]}, {"z": DATA[1]}], "data: series 1 has sites of the shapes {'z': .*expected {'y': .*as series 0 has"),
        ([{"y": DATA[0]}, {"y": DATA[1], "z": DATA[1]}], "data: series 1 has sites of the shapes .*'z'"),
        ([{"y": DATA[0]}, {"y": DATA[1, :, :1]}], r"data: series 1 has sites of the shapes {'y': \(1,\)}"),
        (
            [{"y": DATA[0], "z": DATA[0, :4]}],
            "data: series 0 has the frames {'y': 6, 'z': 4}.*one number of frames for all sites",
        ),
        ([{"y": DATA[0, :0]}], "data: series 0 has the frames {'y': 0}"),
        ([DATA[0]], "data: series 0 is a ndarray .expected a dict of arrays by site"),
        (DATA, "data: a ndarray .expected a dict of arrays"),
    ],
)
def test_series_that_do_not_belong_together(series, match):
    """None of it is dropped, or taken for missing."""
    with pytest.raises(InputError, match=match):
        poseppl.infer_batch(POSED.model, series, poseppl.kalman_filter, KEY)


@pytest.mark.parametrize("rows", [INPUTS[1, :3], INPUTS[1, :5], Constant(np.ones(1)), {"push": 0.0}])
def test_inputs_of_a_series_have_as_many_frames_as_its_data(rows):
    """A row that lacks is not the last one again."""
    series = [{"y": DATA[0]}, {"y": DATA[1, :4]}]
    with pytest.raises(InputError, match="inputs: series 1 has .*expected 4 rows, one for each frame"):
        poseppl.infer_batch(POSED.model, series, poseppl.kalman_filter, KEY, [INPUTS[0], rows])
