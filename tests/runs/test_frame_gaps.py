"""Gaps between frame numbers are reported, or filled with frames without data."""

from __future__ import annotations

import logging
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

import poseppl
from poseppl.errors import InputError
from poseppl.program.clamped import clamp
from poseppl.runs.frame_gaps import Gaps, inputs_of_all_frames

KEY = jax.random.key(0)
FRAMES = [0, 1, 50, 51]
DATA = {"y": np.array([0.3, 0.1, np.nan, -0.4])}
INPUTS = {"push": np.array([0.0, 0.2, -1.0, 0.5]), "noise": poseppl.Constant(0.3)}


def model() -> poseppl.CompiledModel:
    return poseppl.StateSpaceModel(
        lambda params, inputs: numpyro.sample("x", dist.Normal(0.0, 1.0)),
        lambda params, state, inputs: numpyro.sample("x", dist.Normal(state["x"] + inputs["push"], 0.5)),
        lambda params, state, inputs: numpyro.sample("y", dist.Normal(state["x"], inputs["noise"])),
    ).compile({"push": 0.0, "noise": 0.3})


MODEL = model()


def filtered(**options: Any) -> Any:
    return poseppl.infer(MODEL, DATA, poseppl.kalman_filter, KEY, INPUTS, **options)


def test_a_gap_is_reported_and_a_stride_is_none(caplog):
    with caplog.at_level(logging.WARNING, logger="poseppl"):
        filtered(frames=[0, 2, 4, 6])
        filtered(frames=[7, 8, 9, 10])
        assert not caplog.messages
        result = filtered(frames=FRAMES)
    (told,) = caplog.messages
    assert told.startswith("frames 2 to 49 are missing: one transition leads across a gap") and "fill_gaps=True" in told
    assert result["posterior"]["frame"].values.tolist() == FRAMES
    assert any(str(found) == f"warning: The run warned: {told}." for found in poseppl.verdicts(result))


def test_a_filled_gap_is_one_of_frames_without_data(caplog):
    """48 inserted steps widen the state by a variance of 0.25 each, and move it by the last push each."""
    with caplog.at_level(logging.WARNING, logger="poseppl"):
        result = filtered(frames=FRAMES, fill_gaps=True, truth=np.arange(4.0)[:, None])
    (told,) = caplog.messages
    assert told.endswith("48 frames without data are inserted; their inputs repeat those of the frame before")
    assert result["posterior"]["frame"].values.tolist() == list(range(52))
    mean, spread = (result[f"summary/state_{part}"].values[:, 0] for part in ("mean", "sd"))
    np.testing.assert_allclose(spread[49] ** 2 - spread[1] ** 2, 48 * 0.25, rtol=1e-4)
    np.testing.assert_allclose(mean[49] - mean[1], 48 * 0.2, rtol=1e-4)
    data = np.full(52, np.nan)
    data[FRAMES] = DATA["y"]
    np.testing.assert_array_equal(result["observed_data/y"], data.astype(np.float32))
    truth = result["truth/state"].values[:, 0]
    assert truth[FRAMES].tolist() == [0, 1, 2, 3] and np.isnan(truth).sum() == 48
    push = np.r_[0.0, np.full(49, 0.2), -1.0, 0.5]
    inputs = {"push": push, "noise": poseppl.Constant(0.3)}
    by_hand = poseppl.infer(MODEL, {"y": data}, poseppl.kalman_filter, KEY, inputs)
    np.testing.assert_array_equal(result["sample_stats/log_evidence"], by_hand["sample_stats/log_evidence"])
    assert inputs_of_all_frames(INPUTS, FRAMES)["push"].tolist() == push.tolist()


def test_gaps_of_many_kinds():
    """The stride is the greatest that every step is a multiple of."""
    assert Gaps([0, 2, 4, 10]).numbers.tolist() == [0, 2, 4, 6, 8, 10]
    assert Gaps([0, 2, 5]).numbers.tolist() == [0, 1, 2, 3, 4, 5]
    assert str(Gaps([3, 4, 6, 9])) == "frame 5 is missing (and 1 more gap)"
    assert not Gaps([]) and not Gaps([5]) and not Gaps([5, 90])
    assert inputs_of_all_frames((jnp.arange(3), np.ones((3, 2))), [0, 3, 4])[0].tolist() == [0, 0, 0, 1, 2]
    assert inputs_of_all_frames(None, FRAMES) is None


def test_gaps_that_cannot_be_filled_are_refused():
    with pytest.raises(InputError, match="frames: frames 2 to 99999998 are missing .expected at most 1000000 frames"):
        filtered(frames=[0, 1, 99999999, 100000000], fill_gaps=True)
    clamped = clamp(MODEL, ["x"])
    with pytest.raises(InputError, match="fill_gaps: the clamped values of missing frames are unknown"):
        states = poseppl.Clamped.of_trajectory(np.zeros((4, 1)), INPUTS)
        poseppl.infer(clamped, DATA, poseppl.particle_filter, KEY, states, frames=FRAMES, fill_gaps=True)
