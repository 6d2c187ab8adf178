"""The host boundary: NaN becomes a mask, and what cannot be data is refused."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from programs import model

NAN = np.nan


def two_sites(params, state, inputs):
    numpyro.sample("height", dist.Normal(state["level"], 1.0))
    numpyro.sample("points", dist.Normal(state["slope"][:, None], jnp.ones((2, 3))))


def compiled(observation=two_sites):
    return model(observation=observation).compile()


def data(height=0.5, points=None):
    return {"height": height, "points": np.zeros((2, 3)) if points is None else points}


def test_one_frame_and_sequences():
    one = compiled().observe(data())
    assert one.values["points"].shape == one.mask["points"].shape == (2, 3)
    assert one.mask["height"].dtype == bool
    many = compiled().observe(data(np.zeros(4), np.zeros((4, 2, 3))))
    assert many.values["height"].shape == (4,)
    assert compiled().observe(many) is many
    assert compiled().observe(data(np.zeros(4), np.zeros((4, 2, 3))), frames=4).values["points"].shape == (4, 2, 3)


def test_nan_becomes_a_mask_with_a_safe_fill():
    points = np.zeros((2, 3))
    points[1, 2] = NAN
    found = compiled().observe(data(NAN, points))
    assert not found.mask["height"]
    assert found.mask["points"].sum() == 5
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))


@pytest.mark.full
@pytest.mark.parametrize(
    "distribution", [dist.Gamma(2.0, 1.0), dist.Uniform(3.0, 4.0), dist.Poisson(2.0), dist.Categorical(jnp.ones(3) / 3)]
)
def test_fill_is_within_the_support(distribution):
    found = compiled(lambda params, state, inputs: numpyro.sample("y", distribution)).observe({"y": [NAN, NAN]})
    assert distribution.support(found.values["y"]).all()
    assert np.isfinite(distribution.log_prob(found.values["y"])).all()


def test_explicit_mask():
    mask = np.array([[True, False, True], [True, True, False]])
    found = compiled().observe(data(points=np.ones((2, 3))), {"points": mask})
    np.testing.assert_array_equal(found.mask["points"], mask)
    np.testing.assert_array_equal(found.values["points"], mask)


@pytest.mark.parametrize(
    ("values", "mask", "match"),
    [
        ({"height": 0.0}, None, "lacks the observation site 'points'"),
        ({**data(), "heigth": 0.0}, None, "'heigth'.*did you mean 'height'"),
        (data(), {"hight": True}, "mask has 'hight'.*did you mean 'height'"),
        (data(points=np.zeros((3, 2))), None, r"'points' has shape \(3, 2\). Expected \(2, 3\) for one frame, or \(T, 2, 3\)"),
        (data(points=np.zeros(3)), None, "has shape"),
        (data(np.zeros(4), np.zeros((5, 2, 3))), None, "differ in their number of frames"),
        (data(NAN), {"height": np.array(True)}, "NaN at .*which its mask calls observed"),
        (data(np.inf), None, "infinite"),
        (data(), {"height": np.array(1)}, "Expected bool of the shape"),
        (data(), {"points": np.array(True)}, "Expected bool of the shape"),
        (np.zeros(4), None, r"The data are a ndarray. Expected a dict of arrays by site, \['height', 'points'\]"),
        ([data()], None, "The data are a list. Expected a dict"),
    ],
)
def test_refused(values, mask, match):
    with pytest.raises(ValueError, match=match):
        compiled().observe(values, mask)


def test_refused_number_of_frames():
    with pytest.raises(ValueError, match=r"'height' has shape \(4,\). Expected \(3,\)"):
        compiled().observe(data(np.zeros(4), np.zeros((4, 2, 3))), frames=3)


def test_infinity_under_a_mask_is_nobodys_business():
    found = compiled().observe(data(np.inf), {"height": np.array(False)})
    assert np.isfinite(found.values["height"])


def test_event_seen_in_part():
    event = compiled(lambda params, state, inputs: numpyro.sample("y", dist.Normal(jnp.zeros(3), 1.0).to_event(1)))
    assert event.observe({"y": [NAN] * 3}).mask["y"].shape == (3,)
    with pytest.raises(ValueError, match="observed in part.*1 event.*batch dimensions"):
        event.observe({"y": [0.0, NAN, 0.0]})


def test_integers():
    die = compiled(lambda params, state, inputs: numpyro.sample("y", dist.Categorical(jnp.ones(3) / 3)))
    assert die.observe({"y": [2.0, NAN]}).values["y"].dtype == jnp.int32
    with pytest.raises(ValueError, match="no integers"):
        die.observe({"y": 1.5})
    with pytest.raises(ValueError, match="outside the support"):
        die.observe({"y": 3})


def test_counts_that_their_type_cannot_hold():
    counts = compiled(lambda params, state, inputs: numpyro.sample("y", dist.Poisson(2.0)))
    with pytest.raises(ValueError, match="'y' has values that are too large for int32"):
        counts.observe({"y": [5_000_000_000, 1]})


def test_what_a_masked_array_hides_is_missing():
    hidden = np.ma.masked_array([1.0, 99.0, 2.0], [False, True, False])
    found = compiled(lambda params, state, inputs: numpyro.sample("y", dist.Normal(0.0, 1.0))).observe({"y": hidden})
    np.testing.assert_array_equal(found.mask["y"], [True, False, True])
    counts = compiled(lambda params, state, inputs: numpyro.sample("y", dist.Poisson(2.0)))
    np.testing.assert_array_equal(counts.observe({"y": hidden.astype(int)}).mask["y"], [True, False, True])


@pytest.mark.parametrize("missing", [None, NAN, np.float64(NAN)])
def test_missing_among_objects(missing):
    """Columns of a table are often of the type object, which holds numbers and None."""
    found = compiled(lambda params, state, inputs: numpyro.sample("y", dist.Normal(0.0, 1.0))).observe(
        {"y": np.array([1.0, missing, 2], object)}
    )
    np.testing.assert_array_equal(found.mask["y"], [True, False, True])
    assert np.isfinite(found.values["y"]).all()


@pytest.mark.full
@pytest.mark.parametrize(
    ("given", "match"),
    [
        (np.array(["2020-01-01", "2020-01-02"], "M8[D]"), r"of the type datetime64\[D\]. Expected numbers"),
        (np.array([1.0 + 1j]), "of the type complex128"),
        (["1", "x"], "cannot be made an array of numbers: .*'x'"),
        (np.array([1.0, {}], object), "cannot be made an array of numbers"),
        ([[1.0], [1.0, 2.0]], "cannot be made an array of numbers: .*Expected numbers of one shape"),
    ],
)
def test_what_is_no_number(given, match):
    with pytest.raises(ValueError, match=match):
        compiled(lambda params, state, inputs: numpyro.sample("y", dist.Normal(0.0, 1.0))).observe({"y": given})


@pytest.mark.full
def test_unobserved():
    nothing = compiled().unobserved()
    assert not any(np.asarray(mask).any() for mask in nothing.mask.values())
    assert compiled().log_observation(jnp.zeros(3), nothing) == 0
