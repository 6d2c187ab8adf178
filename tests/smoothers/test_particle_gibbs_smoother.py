"""Particle Gibbs on hidden Markov models, whose trajectories can be counted; wrong moves are noticed."""

from __future__ import annotations

import dataclasses
import itertools
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import TWO_STATES, problem, z_scores
from oracles.forward_backward import forward_backward
from poseppl_models.toys.finite_hmm import finite_hmm

from poseppl.program import CompiledModel
from poseppl.smoothers.base import History
from poseppl.smoothers.conditional_smc import conditional_smc, particle_gibbs_smoother

METHODS = ("ancestor", "backward")
INITIAL, TRANSITION, EMISSION = TWO_STATES
SYMBOLS = np.array([0, 2, 2, 0, 1])
CHAINS, DRAWS = 40, 500  # 20,000 draws; the chains are the replicates that standard errors come from


@dataclasses.dataclass(frozen=True, eq=False)
class Indifferent(CompiledModel):
    """A model whose transition density says nothing: ancestors are then drawn by the filter's weights alone."""

    def log_transition(self, x, x_previous, inputs=None):
        return jnp.zeros(())


def ring(num_states):
    """Sticky states in a ring, each with a symbol that it emits most of the time."""
    move = 0.6 * np.eye(num_states) + 0.3 * np.roll(np.eye(num_states), 1, 1) + 0.1 / num_states
    emit = 0.5 * np.eye(num_states) + 0.5 / num_states
    return np.full(num_states, 1 / num_states), move, emit


def history_of(num_frames, num_states):
    particles = jnp.tile(jnp.arange(num_states, dtype=float)[None, :, None], (num_frames, 1, 1))
    ancestors = jnp.tile(jnp.arange(num_states, dtype=jnp.int32), (num_frames, 1))
    return History(particles, jnp.zeros(particles.shape[:2]) - np.log(num_states), ancestors, jnp.zeros(num_frames, bool))


@cache
def two_states():
    model = finite_hmm(INITIAL, TRANSITION, EMISSION).compile()
    mask = np.arange(5) != 3
    return model, model.observe({"y": SYMBOLS}, {"y": mask})


@cache
def trajectories():
    """All 32 trajectories of two states, and their exact probabilities."""
    model, observations = two_states()
    xs = jnp.array(list(itertools.product([0.0, 1.0], repeat=5)))
    log_joint = jax.jit(jax.vmap(lambda x: model.log_joint(x[:, None], observations)))(xs)
    return np.asarray(xs), np.asarray(jax.nn.softmax(log_joint))


def frequencies(states):
    """For each chain the share of its draws in each trajectory (M, 32), from states (T, M, R)."""
    code = np.tensordot(2 ** np.arange(5)[::-1], states.astype(int), 1)
    return np.stack([np.bincount(chain, minlength=32) / chain.size for chain in code])


def frequencies_of_moves(method, wrong=None):
    """Chains of moves by `conditional_smc`, right or wrong."""
    model, observations = two_states()
    if wrong == "ancestors":
        model = Indifferent(**{field.name: getattr(model, field.name) for field in dataclasses.fields(model)})

    def move(xs, key):
        if wrong == "reference":  # a stranger holds its slot
            key, key_other = jax.random.split(key)
            xs = jax.random.bernoulli(key_other, 0.5, xs.shape).astype(xs.dtype)
        moved = conditional_smc(model, key, xs, observations, None, 3, method)
        return moved, moved[:, 0]

    def chain(key):
        return jax.lax.scan(move, jnp.zeros((5, 1)), jax.random.split(key, DRAWS + 20))[1][20:]

    return frequencies(np.asarray(jax.jit(jax.vmap(chain))(jax.random.split(jax.random.key(5), CHAINS))).transpose(2, 0, 1))


def worst(shares):
    """The largest z-score of trajectories that are not too rare for one."""
    exact = trajectories()[1]
    common = exact > 2e-3
    return np.abs(z_scores(shares[:, common], exact[common])).max()


@pytest.mark.parametrize("method", [METHODS[0], *(pytest.param(method, marks=pytest.mark.full) for method in METHODS[1:])])
def test_trajectories_of_two_states_have_their_exact_probabilities(method):
    model, observations = two_states()
    smoother = particle_gibbs_smoother(model, num_particles=3, num_chains=CHAINS, num_draws=DRAWS, num_warmup=20, method=method)
    smoothed = jax.jit(smoother.smooth)(jax.random.key(1), history_of(5, 2), observations)
    states = np.asarray(smoothed.particles)[..., 0]
    assert worst(frequencies(states)) < 5
    exact = forward_backward(INITIAL, TRANSITION, EMISSION, np.where(np.arange(5) == 3, -1, SYMBOLS))[1]
    assert np.abs(z_scores(states.mean(2).T, exact[:, 1])).max() < 5
    info = smoothed.info
    assert ((np.asarray(info.acceptance) > 0.05) & (np.asarray(info.acceptance) < 0.6)).all()
    assert ((np.asarray(info.ess) > 1000) & (np.asarray(info.ess) <= CHAINS * DRAWS)).all()
    assert float(info.num_transition) == 520 * CHAINS * 4 * 3


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("wrong", ["ancestors", "reference"])
def test_wrong_moves_are_noticed(method, wrong):
    assert worst(frequencies_of_moves(method, wrong)) > 20


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_five_states_agree_with_forward_backward(method):
    initial, move, emit = ring(5)
    symbols = np.array([0, 1, 4, 2, 3, 3])
    model = finite_hmm(initial, move, emit).compile()
    smoother = particle_gibbs_smoother(model, num_particles=6, num_chains=CHAINS, num_draws=DRAWS, num_warmup=20, method=method)
    smoothed = jax.jit(smoother.smooth)(jax.random.key(2), history_of(6, 5), model.observe({"y": symbols}))
    states = np.asarray(smoothed.particles)[..., 0]
    shares = np.stack([(states == k).mean(2).T for k in range(5)], -1)
    exact = forward_backward(initial, move, emit, symbols)[1]
    assert np.abs(z_scores(shares, exact)).max() < 5


@pytest.mark.full
@pytest.mark.parametrize(("method", "num_frames"), [("ancestor", 1), ("backward", 3)])
def test_few_frames_and_data_that_no_particle_explains(method, num_frames):
    posed = problem()
    smoother = particle_gibbs_smoother(posed.model, num_particles=2, num_chains=3, num_draws=2, num_warmup=0, method=method)
    observations, inputs = jax.tree.map(lambda leaf: leaf[:num_frames], (posed.observations, posed.inputs))
    impossible = observations._replace(values={"y": observations.values["y"].at[0].set(1e30)})
    history = history_of(num_frames, 2)._replace(particles=jnp.ones((num_frames, 2, 2)))
    smoothed = jax.jit(smoother.smooth)(jax.random.key(0), history, impossible, inputs)
    assert smoothed.particles.shape == (num_frames, 3, 2, 2)
    assert np.isfinite(smoothed.particles).all()


@pytest.mark.full
def test_bad_settings_are_reported():
    model, _ = two_states()
    for settings in ({"num_particles": 1}, {"num_chains": 0}, {"num_draws": 0}, {"num_warmup": -1}, {"method": "forward"}):
        with pytest.raises(ValueError, match=next(iter(settings))):
            particle_gibbs_smoother(model, **settings)
