"""Outputs of a frame: thinned draws, and summaries over all draws."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from poseppl_models.toys.linear_gaussian import linear_gaussian

import poseppl
from poseppl.diagnostics.run_figures import figures_of_run
from poseppl.errors import InputError
from poseppl.filters import FilterInfo, ParticleState
from poseppl.filters.chains import chain_state
from poseppl.program import StateSpaceModel
from poseppl.runs.collectors import collect_draws
from poseppl.runs.contents import nearest_turn
from poseppl.runs.results import QUANTILES

MODEL = linear_gaussian(2).compile()
KEY = jax.random.key(0)
NORMAL = dist.Normal(0.0, 1.0)
PAIR = dist.Normal(0.0, 1.0).expand([2])
INFO = FilterInfo(*[jnp.zeros(())] * 9)


def test_chains_are_thinned_evenly_and_summarised_whole() -> None:
    """Every fifth of 23 draws, the last of them included."""
    draws = np.random.default_rng(0).normal(size=(3, 23, 2)).astype(np.float32)
    collect = collect_draws(MODEL, max_draws=5, extras=lambda x, inputs: {"square": x**2}, mean_only=("square",))
    kept = jax.jit(collect)(KEY, chain_state(jnp.asarray(draws), jnp.zeros(())), INFO, None)
    np.testing.assert_array_equal(kept.state, draws[:, 2::5])
    assert kept.extras == {}
    pooled = draws.reshape(-1, 2)
    np.testing.assert_allclose(kept.summary["state_mean"], pooled.mean(0), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(kept.summary["state_sd"], pooled.std(0, ddof=1), rtol=1e-5)
    np.testing.assert_allclose(kept.summary["state_quantile"], np.quantile(pooled, QUANTILES, axis=0), rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(kept.summary["square_mean"], (pooled**2).mean(0), rtol=1e-5)


def test_all_draws_of_short_chains_are_kept() -> None:
    draws = jnp.arange(24.0).reshape(2, 6, 2)
    kept = jax.jit(collect_draws(MODEL, max_draws=6))(KEY, chain_state(draws, jnp.zeros(())), INFO, None)
    np.testing.assert_array_equal(kept.state, draws)


def test_chains_of_unequal_weights_are_kept_by_them() -> None:
    """Four chains lie apart; the first has half of the weight, the last none."""
    draws = jnp.asarray(np.arange(4.0)[:, None, None] + np.random.default_rng(0).uniform(0, 0.5, (4, 6, 2)))
    state = chain_state(draws, jnp.zeros(()), log_weights=jnp.log(jnp.array([0.5, 0.25, 0.25, 0.0])))
    kept = jax.jit(collect_draws(MODEL, max_draws=6))(KEY, state, INFO, None)
    np.testing.assert_array_equal(kept.state, draws[jnp.array([0, 0, 1, 2])])
    np.testing.assert_allclose(kept.summary["state_mean"], draws.mean(1).T @ np.array([0.5, 0.25, 0.25, 0.0]), rtol=1e-5)


@pytest.mark.full
def test_weighted_particles() -> None:
    rng = np.random.default_rng(1)
    number, shift = 20_000, 0.7
    particles = rng.normal(size=(number, 2))
    # importance weights that turn N(0, 1) into N(shift, 1) in the first coordinate
    log_weights = shift * particles[:, 0]
    collect = collect_draws(MODEL, max_draws=400, extras=lambda x, inputs: {})
    kept = jax.jit(collect)(KEY, ParticleState(jnp.asarray(particles), jnp.asarray(log_weights)), INFO, None)
    effective = number / np.exp(shift**2)
    assert kept.state.shape == (1, 400, 2)
    mean, spread, quantile = (kept.summary[f"state_{name}"] for name in ("mean", "sd", "quantile"))
    np.testing.assert_allclose(mean, [shift, 0], atol=5 / np.sqrt(effective))
    np.testing.assert_allclose(spread, 1, atol=5 / np.sqrt(2 * effective))
    # the density at the 5 % quantile of a normal is 0.103
    error = 5 * np.sqrt(0.05 * 0.95 / 2000) / 0.103
    np.testing.assert_allclose(quantile[0], [shift - 1.645, -1.645], atol=error)
    np.testing.assert_allclose(kept.state[0].mean(0), [shift, 0], atol=5 / np.sqrt(400))
    # a deliberately wrong variant: the weights left out
    assert abs(particles[:, 0].mean() - shift) > 5 / np.sqrt(effective)


@pytest.mark.full
def test_weightless_particles_are_not_read() -> None:
    particles = jnp.array([[1.0, 2.0], [jnp.nan, jnp.inf], [3.0, 4.0]])
    log_weights = jnp.log(jnp.array([0.5, 0.0, 0.5]))
    kept = jax.jit(collect_draws(MODEL, max_draws=4))(KEY, ParticleState(particles, log_weights), INFO, None)
    np.testing.assert_allclose(kept.summary["state_mean"], [2.0, 3.0])
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(kept))


def test_max_draws_is_checked() -> None:
    with pytest.raises(ValueError, match="max_draws is 0"):
        collect_draws(MODEL, max_draws=0)


@pytest.mark.full
def test_no_key_is_used_twice() -> None:
    """Draws that are kept and those for the quantiles are resampled apart."""
    particles = jax.random.normal(jax.random.key(1), (50, 2))
    with jax.debug_key_reuse(True):
        collect = jax.jit(
            lambda key: collect_draws(MODEL, max_draws=4)(key, ParticleState(particles, particles[:, 0]), INFO, None)
        )
        assert collect(jax.random.key(0)).state.shape == (1, 4, 2)


@pytest.mark.parametrize(
    ("sites", "taken"),
    [
        ({"state": dist.LogNormal(0.0, 1.0)}, "state"),
        ({"state": PAIR, "level": NORMAL}, "state"),
        ({"level": NORMAL, "frame": NORMAL}, "frame"),
        ({"state": PAIR}, None),
        ({"state": dist.Categorical(jnp.array([0.4, 0.6])), "level": NORMAL}, None),
    ],
)
def test_names_that_results_give_to_something_else(sites, taken):
    """The mean of the flat state would pass for that of a positive site called state."""

    def program(*arguments):
        for name, distribution in sites.items():
            numpyro.sample(name, distribution)

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(0.0, 1.0))

    model = StateSpaceModel(program, program, observation).compile()
    if taken is None:
        collect_draws(model)
        return
    with pytest.raises(InputError, match=f"{taken}: a site is called '{taken}', as results call .*expected another name"):
        collect_draws(model)


def compass() -> StateSpaceModel:
    def initial(params, inputs):
        numpyro.sample("heading", dist.VonMises(jnp.array([3.1, 0.5]), 20.0))
        numpyro.sample("speed", NORMAL)

    def transition(params, state, inputs):
        numpyro.sample("heading", dist.VonMises(state["heading"], 20.0))
        numpyro.sample("speed", NORMAL)

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["speed"], 1.0))

    return StateSpaceModel(initial, transition, observation)


@pytest.mark.parametrize("form", ["particles", "chains"])
@pytest.mark.parametrize("turns", [0, 3])
def test_angles_on_both_sides_of_pi_are_near_each_other(form: str, turns: int) -> None:
    """Their summary is that of the same angles counted from 0 on, or from where whole turns have led them."""
    model, rng = compass().compile(), np.random.default_rng(0)
    number, turn = 4000, 2 * np.pi
    through = np.stack([3.1 + 0.3 * rng.normal(size=number), 0.5 + 0.2 * rng.normal(size=number), rng.normal(size=number)], 1)
    wrapped = through.copy()
    wrapped[:, :2] = (through[:, :2] + np.pi) % turn - np.pi + turns * turn
    log_weights = np.log(rng.uniform(0.5, 1.5, number)) if form == "particles" else np.zeros(number)
    if form == "particles":
        state = ParticleState(jnp.asarray(wrapped), jnp.asarray(log_weights))
    else:
        state = chain_state(jnp.asarray(wrapped.reshape(4, -1, 3)), jnp.zeros(()))
    kept = jax.jit(collect_draws(model))(KEY, state, INFO, None)
    weights = np.exp(log_weights) / np.exp(log_weights).sum()
    mean = weights @ through
    spread = np.sqrt(weights @ (through - mean) ** 2)
    wanted = mean[:2] + turns * turn
    found = np.asarray(kept.summary["heading_mean"])
    assert abs((found - wanted + np.pi) % turn - np.pi).max() < 1e-4 and abs(found - wanted).max() < 4.0
    np.testing.assert_allclose(kept.summary["heading_sd"], spread[:2], rtol=1e-3)
    levels = np.quantile(through[:, :2], QUANTILES, axis=0) - mean[:2]
    # of 2000 resampled draws: five standard errors of the outermost levels
    np.testing.assert_allclose(np.asarray(kept.summary["heading_quantile"]) - found, levels, atol=5 * 0.3 * 2.1 / np.sqrt(2000))
    np.testing.assert_allclose(kept.summary["speed_mean"], mean[2], rtol=1e-4, atol=1e-5)


@pytest.mark.full
def test_a_true_angle_is_one_in_any_turn() -> None:
    """90 % intervals about 3.1 contain a truth of -3.1, but not one that is 0.5 off the other way; errors agree."""
    model = compass().compile()
    truth = np.array([[-3.1, 0.5, 0.0], [3.0, 0.5 + 2 * np.pi, 0.0], [0.5, -3.1, 0.0]])
    result = poseppl.infer(model, {"y": np.zeros(3)}, poseppl.particle_filter(model, 2000), KEY, truth=truth)
    inside = poseppl.diagnose(result)["diagnostics/inside"].sel(level=0.9).values
    assert inside[:, :2].tolist() == [[True, True], [True, True], [False, False]]
    # those about 3.1 are 0.1 below and 0.08 above the truths, of deviations of about 0.3, so that neither is at an end
    ranks = poseppl.diagnose(result)["diagnostics/probability_transform"].values
    assert ((ranks[:2, :2] > 0.05) & (ranks[:2, :2] < 0.95)).all() and (np.abs(ranks[2, :2] - 0.5) > 0.49).all()
    error = figures_of_run(result)["error"].values
    np.testing.assert_allclose(error[:2, :2], [[0.08, 0.0], [0.1, 0.0]], atol=0.05)
    assert (error[2, :2] > 2.0).all()
    series = poseppl.one_series(poseppl.infer_batch(model, [{"y": np.zeros(3)}], poseppl.particle_filter(model, 50), KEY), 0)
    assert series.attrs["circular"] == result.attrs["circular"] == '["heading[0]", "heading[1]"]'
    for hostile in ("no list", "{}", "[1, null]"):
        series.attrs["circular"] = hostile
        np.testing.assert_array_equal(nearest_turn(series, truth, truth + 9.0), truth)
