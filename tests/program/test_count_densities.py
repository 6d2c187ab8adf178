"""Densities of large counts in float32, against SciPy in float64."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from programs import model
from scipy import special, stats

from poseppl.program.count_densities import is_rounded_count, stable

MEANS = np.array([0.3, 3.0, 15.0, 17.0, 200.0, 3e4, 1e6, 9.9e6], np.float32)
SCORES = np.array([-3.0, -1.0, 0.0, 0.5, 3.0])[:, None]
"""Standard deviations of the counts from their means."""


def log_prob(distribution, value):
    return stable(distribution).log_prob(value)


def counts_near(means, variances):
    return np.maximum(np.round(means + SCORES * np.sqrt(variances)), 0).astype(np.int32)


def poisson():
    rate = MEANS.astype(float)
    return dist.Poisson(jnp.asarray(MEANS)), counts_near(rate, rate), lambda x: stats.poisson.logpmf(x, rate)


def binomial(share, of_logits=False):
    total = 10_000_000 if share < 1e-3 else np.array([1, 40, 2000, 1_000_000, 10_000_000])
    given = np.float32(np.log(share) - np.log1p(-share)) if of_logits else np.float32(share)
    p = special.expit(float(given)) if of_logits else float(given)
    law = dist.BinomialLogits(given, total) if of_logits else dist.BinomialProbs(given, total)
    counts = np.minimum(counts_near(total * p, total * p * (1 - p)), total)
    return law, counts, lambda x: stats.binom.logpmf(x, total, p)


def negative_binomial(size, form):
    size = np.float32(size)
    given = {
        "gamma": size / MEANS,
        "mean": MEANS,
        "probs": MEANS / (MEANS + size),
        "logits": np.log(MEANS) - np.log(size),
    }[form].astype(np.float32)
    build = {
        "gamma": lambda: dist.GammaPoisson(size, jnp.asarray(given)),
        "mean": lambda: dist.NegativeBinomial2(jnp.asarray(given), size),
        "probs": lambda: dist.NegativeBinomialProbs(size, jnp.asarray(given)),
        "logits": lambda: dist.NegativeBinomialLogits(size, jnp.asarray(given)),
    }[form]
    wide, size = given.astype(float), float(size)
    p = {
        "gamma": wide / (1 + wide),
        "mean": size / (size + wide),
        "probs": 1 - wide,
        "logits": special.expit(-wide),
    }[form]
    mean = size * (1 - p) / p
    return build(), counts_near(mean, mean + mean**2 / size), lambda x: stats.nbinom.logpmf(x, size, p)


CASES = {
    "Poisson": poisson,
    "Binomial, a few of ten million": lambda: binomial(2e-6),
    "Binomial, 30 %": lambda: binomial(0.3),
    "Binomial, 99.9 %": lambda: binomial(0.999),
    "Binomial of logits, 0.1 %": lambda: binomial(1e-3, of_logits=True),
    "Binomial of logits, 50 %": lambda: binomial(0.5, of_logits=True),
    **{
        f"negative binomial of {form}, size {size:g}": lambda size=size, form=form: negative_binomial(size, form)
        for form, size in (("gamma", 0.3), ("gamma", 1e6), ("mean", 3.0), ("mean", 1e4), ("probs", 50.0), ("logits", 7.0))
    },
}


@pytest.mark.parametrize("name", CASES)
def test_equal_to_scipy(name):
    law, counts, exact = CASES[name]()
    found = log_prob(law, jnp.asarray(counts))
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, exact(counts), rtol=2e-6, atol=5e-4)


@pytest.mark.parametrize("name", ["Poisson", "Binomial, 30 %", "negative binomial of logits, size 7"])
def test_as_exact_in_float64_as_scipy(name):
    with jax.enable_x64(True):
        law, counts, exact = CASES[name]()
        np.testing.assert_allclose(log_prob(law, jnp.asarray(counts)), exact(counts), rtol=1e-10, atol=1e-7)


@pytest.mark.full
def test_gradients():
    rate, x = np.float32(1_001_000.0), 1_000_000
    found = jax.grad(lambda rate: log_prob(dist.Poisson(rate), x))(rate)
    np.testing.assert_allclose(found, x / float(rate) - 1, rtol=1e-5)
    logit, n, k = np.float32(0.25), 9_000_000, 5_060_000
    found = jax.grad(lambda logit: log_prob(dist.BinomialLogits(logit, n), k))(logit)
    np.testing.assert_allclose(found, k - n * special.expit(0.25), rtol=1e-3)
    probs = np.float32(0.25)
    found = jax.grad(lambda p: log_prob(dist.BinomialProbs(p, n), 2_252_000))(probs)
    np.testing.assert_allclose(found, 2_252_000 / 0.25 - (n - 2_252_000) / 0.75, rtol=1e-4)
    size, scale, x = 4.0, float(np.float32(2e-6)), 2_500_000
    found = jax.grad(lambda pair: log_prob(dist.GammaPoisson(*pair), x))((np.float32(size), np.float32(scale)))
    of_size = special.digamma(size + x) - special.digamma(size) - np.log1p(1 / scale)
    np.testing.assert_allclose(found, [of_size, size / scale - (size + x) / (1 + scale)], rtol=1e-5)
    np.testing.assert_allclose(jax.hessian(lambda rate: log_prob(dist.Poisson(rate), 5))(3.0), -5 / 9, rtol=1e-5)


@pytest.mark.parametrize(
    ("law", "parameter", "x", "value", "slope"),
    [
        (dist.Poisson, 0.0, 0, 0.0, -1.0),
        (dist.Poisson, 0.0, 2, -np.inf, None),
        (dist.Poisson, 3.0, 0, -3.0, -1.0),
        (dist.Poisson, 3.0, -1, -np.inf, None),
        (dist.Poisson, 1e-30, 2, 2 * np.log(1e-30) - np.log(2), 2e30),
        (lambda p: dist.BinomialProbs(p, 7), 0.0, 0, 0.0, -7.0),
        (lambda p: dist.BinomialProbs(p, 7), 0.0, 1, -np.inf, None),
        (lambda p: dist.BinomialProbs(p, 7), 1.0, 7, 0.0, 7.0),
        (lambda p: dist.BinomialProbs(p, 7), 1.0, 6, -np.inf, None),
        (lambda p: dist.BinomialProbs(p, 7), 0.25, 8, -np.inf, None),
        (lambda p: dist.BinomialProbs(p, 7), 0.25, -1, -np.inf, None),
        (lambda p: dist.BinomialProbs(p, 7), 0.25, 0, 7 * np.log(0.75), -7 / 0.75),
        (lambda p: dist.BinomialProbs(p, 7), 0.25, 7, 7 * np.log(0.25), 7 / 0.25),
        (lambda p: dist.BinomialProbs(p, 0), 0.25, 0, 0.0, 0.0),
        (lambda a: dist.BinomialLogits(a, 7), -200.0, 2, np.log(21) - 400, 2.0),
        (lambda a: dist.NegativeBinomialLogits(3.0, a), -200.0, 2, np.log(6) - 400, 2.0),
        (lambda p: dist.NegativeBinomialProbs(3.0, p), 0.0, 0, 0.0, -3.0),
        (lambda p: dist.NegativeBinomialProbs(3.0, p), 0.0, 1, -np.inf, None),
        (lambda mean: dist.NegativeBinomial2(mean, 3.0), 2.0, 0, 3 * np.log(3 / 5), -3 / 5),
        (lambda mean: dist.NegativeBinomial2(mean, 3.0), 2.0, -1, -np.inf, None),
    ],
)
def test_edges(law, parameter, x, value, slope):
    found, gradient = jax.value_and_grad(lambda parameter: log_prob(law(parameter), x))(np.float32(parameter))
    np.testing.assert_allclose(found, value, rtol=1e-6, atol=1e-6)
    assert np.isfinite(gradient)
    if slope is not None:
        np.testing.assert_allclose(gradient, slope, rtol=1e-5)


def test_wrappers_keep_shapes_masks_and_sums():
    rate, x = np.array([[1e6], [2e6]]), np.full((4, 2, 3), 1_000_500)
    seen = np.array([True, False, True])
    law = dist.Poisson(jnp.asarray(rate)).expand((4, 2, 3)).mask(jnp.asarray(seen)).to_event(1)
    exact = np.where(seen, stats.poisson.logpmf(x, rate), 0.0).sum(-1)
    np.testing.assert_allclose(log_prob(law, jnp.asarray(x)), exact, rtol=1e-5)
    assert log_prob(law, jnp.asarray(x)).shape == (4, 2)


def test_inflated_and_mixed_counts():
    x, exact = 1_000_500, stats.poisson.logpmf(1_000_500, 1e6)
    found = log_prob(dist.ZeroInflatedPoisson(0.2, rate=1e6), x)
    np.testing.assert_allclose(found, np.log(0.8) + exact, atol=1e-4)
    of_two = dist.Categorical(jnp.array([0.5, 0.5]))
    same = dist.MixtureSameFamily(of_two, dist.Poisson(jnp.array([1e6, 2e6])))
    mixed = dist.MixtureGeneral(of_two, [dist.Poisson(1e6), dist.NegativeBinomial2(2e6, 1e9)])
    for law in (same, mixed):
        np.testing.assert_allclose(log_prob(law, x), np.log(0.5) + exact, atol=1e-4)
    normal = dist.Normal(0.0, 1.0)
    assert stable(normal) is normal


def test_densities_that_stay_rounded():
    rounded = [dist.BetaBinomial(2.0, 3.0, 10), dist.Multinomial(10, jnp.ones(3) / 3).mask(True)]
    exact = [
        dist.Poisson(2.0),
        dist.ZeroInflatedPoisson(0.1, rate=2.0),
        dist.Categorical(jnp.ones(3) / 3),
        dist.Normal(0.0, 1.0),
    ]
    assert all(map(is_rounded_count, rounded)) and not any(map(is_rounded_count, exact))


def visitors(params, state, inputs):
    """Two counts a frame of which one may be missing."""
    numpyro.sample("y", dist.NegativeBinomial2(3e6 * jnp.exp(state["level"] + jnp.array([0.0, 0.1])), 900.0))


def screened(params, state, inputs):
    """Tests of a whole country, of which a state's share is positive."""
    numpyro.sample("y", dist.Binomial(total_count=8_000_000, logits=state["level"] - 2.0))


def half_believed(params, state, inputs):
    with numpyro.handlers.scale(scale=0.5), numpyro.plate("stations", 3):
        numpyro.sample("y", dist.Poisson(1e6 * jnp.exp(state["level"])))


LEVEL = 0.01


@pytest.mark.parametrize(
    ("observation", "y", "exact"),
    [
        (visitors, [3_020_000.0, np.nan], lambda y: stats.nbinom.logpmf(y[0], 900, 900 / (900 + 3e6 * np.exp(LEVEL)))),
        (screened, 963_000, lambda y: stats.binom.logpmf(y, 8_000_000, special.expit(LEVEL - 2.0))),
        (
            half_believed,
            [1_010_000, 1_011_000, 1_008_500],
            lambda y: 0.5 * stats.poisson.logpmf(y, 1e6 * np.exp(LEVEL)).sum(),
        ),
    ],
)
def test_likelihoods_of_models(observation, y, exact):
    compiled = model(observation=observation).compile()
    x = compiled.to_flat({"level": jnp.array(LEVEL), "slope": jnp.zeros(2)})
    found = compiled.log_observation(x, compiled.observe({"y": y}))
    np.testing.assert_allclose(found, exact(np.asarray(y)), atol=3e-3)


@pytest.mark.parametrize(
    "law",
    [
        lambda: dist.BetaBinomial(2.0, 3.0, 1_000_000),
        lambda: dist.Multinomial(1_000_000, jnp.array([0.9, 0.1])),
        lambda: dist.ZeroInflatedDistribution(dist.BetaBinomial(2.0, 3.0, 1_000_000), gate=0.1),
    ],
)
def test_large_counts_of_other_distributions_are_warned_of(law, caplog):
    compiled = model(observation=lambda params, state, inputs: numpyro.sample("y", law())).compile()
    counts = [900_000, 100_000] if law().event_shape else 900_000
    compiled.observe({"y": counts})
    compiled.observe({"y": counts})
    assert len(caplog.messages) == 1
    assert "observation 'y'" in caplog.messages[0] and "jax_enable_x64" in caplog.messages[0]


def test_small_or_exact_counts_are_not_warned_of(caplog):
    beta = dist.BetaBinomial(2.0, 3.0, 1_000_000)
    for law, count in ((beta, 1000), (dist.Poisson(1e6), 1_000_000), (dist.DiscreteUniform(0, 10**6), 10**6)):
        model(observation=lambda params, state, inputs, law=law: numpyro.sample("y", law)).compile().observe({"y": count})
    with jax.enable_x64(True):
        model(observation=lambda params, state, inputs: numpyro.sample("y", beta)).compile().observe({"y": 900_000})
    assert not caplog.messages
