"""The mirror model: its density from the formula, its two modes from a filter against a grid."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from law_problems import independent
from poseppl_models.toys.mirror import mirror, mirror_mean

from poseppl.filters import particle_filter


def test_joint_density():
    model = mirror(level=2.0, width=0.5, spread=0.7, start=1.5, noise=0.3).compile()
    xs, ys, sides = np.array([0.5, -1.8, -2.2]), np.array([0.6, 2.0, 2.5]), np.array([0.4, np.nan, -2.0])
    expected = scipy.stats.norm.logpdf(xs[0], 0, 1.5) + scipy.stats.norm.logpdf(xs[1:], 2 * np.tanh(xs[:-1] / 0.5), 0.7).sum()
    expected += scipy.stats.norm.logpdf(ys, np.abs(xs), 0.3).sum() + scipy.stats.norm.logpdf([0.4, -2.0], xs[[0, 2]], 0.3).sum()
    found = jax.jit(model.log_joint)(xs[:, None], model.observe({"y": ys, "side": sides}))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


@pytest.mark.full
@pytest.mark.parametrize("told", [False, True])
def test_a_filter_keeps_both_sides_unless_the_side_is_observed(told):
    """If the side is never observed, both have the same probability; a state observed at the start stays on its side."""
    model, num_frames = mirror().compile(), 10
    built = particle_filter(model, 300)
    sides = np.full(num_frames, np.nan)
    sides[0] = 3.0 if told else np.nan
    observations = model.observe({"y": np.full(num_frames, 3.0), "side": sides})

    def one(rng_key):
        keys = jax.random.split(rng_key, num_frames)
        state, _ = built.init(keys[0], jax.tree.map(lambda a: a[0], observations))

        def step(state, row):
            return built.step(row[0], state, row[1])[0], None

        state, _ = jax.lax.scan(step, state, (keys[1:], jax.tree.map(lambda a: a[1:], observations)))
        return jnp.exp(state.log_weights) @ (state.particles[:, 0] > 0)

    shares = np.asarray(independent(one, 40), float)
    if told:
        assert shares.min() > 0.99
    else:
        assert abs(shares.mean() - 0.5) < 5 * shares.std(ddof=1) / np.sqrt(40)
        assert ((shares > 0.1) & (shares < 0.9)).mean() > 0.8


@pytest.mark.full
def test_mean_keeps_the_side():
    x = np.array([-4.0, -0.2, 0.2, 4.0])
    np.testing.assert_array_equal(np.sign(mirror_mean(x)), np.sign(x))


@pytest.mark.full
def test_numbers_that_are_not_positive_are_refused():
    with pytest.raises(ValueError, match=r"noise is 0.0. Expected a positive"):
        mirror(noise=0.0)
