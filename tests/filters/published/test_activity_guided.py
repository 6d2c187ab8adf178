"""The activity-guided annealed filter against a plain NumPy loop, and Eq. 12 at its edges."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from law_problems import problem, replicate
from oracles import activity_guided as oracle
from poseppl_models.toys.growth import growth

from poseppl.errors import UnsuitableModelError
from poseppl.filters import activity_guided_filter, annealed_filter
from poseppl.filters.published.activity_guided import emit, num_transitions, transition_powers
from poseppl.program import StateSpaceModel
from poseppl.program.hidden_chain import HiddenChain, chain_sites, hidden_chain

TRANSITION = np.array([[0.8, 0.2, 0.0], [0.0, 0.6, 0.4], [0.5, 0.0, 0.5]])
MEANS, SDS = np.array([-2.0, 0.0, 1.5]), np.array([0.5, 0.7, 0.4])
WALK = 0.6
CHAIN = HiddenChain(jnp.asarray(TRANSITION), jnp.asarray(MEANS)[:, None], jnp.asarray(SDS**2)[:, None, None])


def model():
    """A chain of three states that emits a number, and a number that walks; their sum and the second are observed."""

    def start(params, inputs):
        numpyro.sample("place", dist.Normal(0.0, WALK))
        k = numpyro.sample("k", dist.Categorical(probs=np.full(3, 1 / 3)))
        numpyro.sample("f", dist.Normal(jnp.asarray(MEANS)[k], jnp.asarray(SDS)[k]))

    def move(params, state, inputs):
        numpyro.sample("place", dist.Normal(state["place"], WALK))
        k = numpyro.sample("k", dist.Categorical(probs=jnp.asarray(TRANSITION)[state["k"]]))
        numpyro.sample("f", dist.Normal(jnp.asarray(MEANS)[k], jnp.asarray(SDS)[k]))

    def observe(params, state, inputs):
        numpyro.sample("sum", dist.Normal(state["f"] + state["place"], 0.3))
        numpyro.sample("seen", dist.Normal(state["place"], 0.5))

    return StateSpaceModel(start, move, observe).compile()


@pytest.mark.full
def test_the_chain_is_read_off_the_program():
    compiled = model()
    sites = chain_sites(compiled)
    assert (sites.finite.name, sites.emission.name, sites.num_values) == ("k", "f", 3)
    found = hidden_chain(compiled, sites, jnp.zeros(3))
    for leaf, exact in zip(found, CHAIN, strict=True):
        np.testing.assert_allclose(leaf, exact, atol=1e-6)


@pytest.mark.full
@pytest.mark.parametrize("temperature", [0.0, 1e-3, 0.2, 0.36, 0.6, 0.9, 0.999])
def test_so_many_transitions_leave_a_state(temperature):
    staying = np.array([0.0, 0.1, 0.4, 0.8, 0.97, 1.0])
    found = num_transitions(jnp.asarray(staying, jnp.float32), jnp.float32(temperature))
    assert found.tolist() == [oracle.num_transitions(each, temperature) for each in staying]


def test_rows_of_powers():
    powers = np.array([0, 3, 9000])
    found = transition_powers(jnp.asarray(TRANSITION), jnp.asarray(powers))
    exact = [np.linalg.matrix_power(TRANSITION, power)[row] for row, power in enumerate(powers)]
    np.testing.assert_allclose(found, exact, atol=1e-5)


@pytest.mark.parametrize(
    ("own", "shrinking", "temperature"),
    [(True, 0.25, 0.7), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((False, 1.0, 0.7), (True, 0.5, 0.0)))],
)
def test_emissions_are_those_of_a_loop(own, shrinking, temperature):
    """Fractions of states, and means and variances of what is emitted, from three places; 5 standard errors."""
    count, rng = 20_000, np.random.default_rng(0)
    for value in (-2.2, 0.3, 1.2):
        values = jnp.full((count, 1), value)
        states, emissions = emit(jax.random.key(1), CHAIN, values, jnp.float32(shrinking), temperature, own=own)
        plain = np.array(
            [oracle.emitted(rng, (TRANSITION, MEANS, SDS), value, shrinking, temperature, own) for _ in range(1500)]
        )
        for state in range(3):
            here, there = np.asarray(states == state), plain[:, 0] == state
            share = (here.sum() + there.sum()) / (count + len(plain))
            error = np.sqrt(share * (1 - share) * (1 / count + 1 / len(plain)))
            assert abs(here.mean() - there.mean()) <= 5 * error
            if share > 0.01:
                mine, other = np.asarray(emissions[:, 0])[here], plain[there, 1]
                scale = SDS[state] * np.sqrt(shrinking) * np.sqrt(1 / len(mine) + 1 / len(other))
                assert abs(mine.mean() - other.mean()) < 5 * scale
                assert abs(np.log(mine.std() / other.std())) < 5 * np.sqrt(0.5 / len(mine) + 0.5 / len(other))


PARTICLES, RUNS = 30, 200
SETTINGS = {"num_layers": 4, "survival": 0.5, "temperature": 0.5}
DATA = {"sum": 1.6, "seen": 0.4}


def log_likelihood(value, place):
    return -0.5 * ((DATA["sum"] - value - place) / 0.3) ** 2 - 0.5 * ((DATA["seen"] - place) / 0.5) ** 2


def beginning():
    rng = np.random.default_rng(3)
    particles = np.stack([rng.integers(0, 3, PARTICLES), rng.normal(0, 1.2, PARTICLES), rng.normal(0, 1, PARTICLES)], 1)
    return particles, oracle.normalised(rng.normal(size=PARTICLES))


def frame_of_ours(**settings):
    """For each run the weighted mean of (state, emission, place), and the variances about it (RUNS, 6)."""
    compiled = model()
    step = activity_guided_filter(compiled, PARTICLES, diffusion=jnp.array([WALK**2, 0.0, 0.0]), **settings).step
    particles, weights = beginning()
    first, _ = activity_guided_filter(compiled, PARTICLES, **settings).init(jax.random.key(0), compiled.observe(DATA), None)
    state = first._replace(
        particles=jnp.asarray(particles[:, [2, 0, 1]], jnp.float32), log_weights=jnp.log(jnp.asarray(weights, jnp.float32))
    )
    data = compiled.observe(DATA)
    run = jax.jit(lambda key: step(key, state, data, None)[0])
    states = jax.lax.map(run, jax.random.split(jax.random.key(1), RUNS))
    return summaries(np.asarray(states.particles)[:, :, [1, 2, 0]], np.exp(states.log_weights))


def summaries(particles, weights):
    means = np.einsum("rn,rnd->rd", weights, particles)
    spreads = np.einsum("rn,rnd->rd", weights, (particles - means[:, None]) ** 2)
    return np.concatenate([means, spreads], 1).astype(float)


def z_scores_of_two(first, second):
    return (first.mean(0) - second.mean(0)) / np.sqrt(first.var(0, ddof=1) / len(first) + second.var(0, ddof=1) / len(second))


@pytest.mark.slow
def test_a_frame_is_that_of_a_loop():
    """Over many runs; colder transitions, and emissions that never stay where they are, are noticed."""
    rng = np.random.default_rng(7)
    plain = [
        oracle.filter_frame(rng, (TRANSITION, MEANS, SDS), WALK, log_likelihood, *beginning(), **SETTINGS) for _ in range(RUNS)
    ]
    exact = summaries(*(np.array(column) for column in zip(*plain, strict=True)))
    assert np.abs(z_scores_of_two(frame_of_ours(**SETTINGS), exact)).max() < 5
    assert np.abs(z_scores_of_two(frame_of_ours(**SETTINGS | {"temperature": 0.0}), exact)).max() > 10
    assert np.abs(z_scores_of_two(frame_of_ours(**SETTINGS | {"num_layers": 1}), exact)).max() > 10


@pytest.mark.slow
def test_without_a_chain_it_is_the_annealed_filter():
    posed = problem()
    ours, theirs = (
        replicate(build(posed.model, 50, num_layers=3), posed, 4) for build in (activity_guided_filter, annealed_filter)
    )
    for mine, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-4, atol=1e-5)


@pytest.mark.full
def test_what_is_no_chain_is_refused():
    def start(params, *rest):
        numpyro.sample("k", dist.Categorical(probs=np.full(3, 1 / 3)))
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    alone = StateSpaceModel(
        start, start, lambda params, state, inputs: numpyro.sample("y", dist.Normal(state["x"], 1.0))
    ).compile()
    with pytest.raises(UnsuitableModelError, match=r"'k' decides \[\]"):
        activity_guided_filter(alone, 10).init(jax.random.key(0), alone.observe({"y": 0.0}), None)
    with pytest.raises(ValueError, match="temperature is 1"):
        activity_guided_filter(growth().compile(1.0), 10, temperature=1.0)
