"""The factored-state hierarchical hidden Markov model: exact answers on tiny ones, and the motion of a body."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from poseppl_models.bodies.factored_motion import NextBins, factored_motion, first_frame, next_frame, pose_of_bins, turned

from poseppl.filters import hidden_markov_filter, particle_filter
from poseppl.motion.learned import FactoredTables, bin_angles
from poseppl.program import StateSpaceModel

pytestmark = pytest.mark.full

PHASES, ROTATIONS, BINS, FRAMES = 2, 2, 3, 3


class Inputs(NamedTuple):
    """Inputs of the programs."""

    activity: FactoredTables
    start: object = None
    start_scale: object = None
    step_scale: object = None
    seconds: float = 0.04


def tiny(seed: int = 0) -> FactoredTables:
    """Random tables in which each phase knows no successor of some bins."""
    rng = np.random.default_rng(seed)
    steps = rng.dirichlet(np.ones(BINS), (PHASES, ROTATIONS, BINS))
    steps[0, 0, 1] = steps[1, 1, 2] = steps[1, 0, 0] = 0.0
    tables = (
        rng.dirichlet(np.ones(PHASES)),
        rng.dirichlet(np.ones(BINS), (PHASES, ROTATIONS)),
        rng.dirichlet(np.ones(PHASES), PHASES),
        rng.dirichlet(np.ones(BINS), (PHASES, ROTATIONS)),
        steps,
        rng.normal(size=(PHASES, 3)),
    )
    return FactoredTables(*(jnp.asarray(table, float) for table in tables))


def observe(params, bins, inputs):
    numpyro.sample("seen", dist.Normal(jnp.sum(jnp.asarray([1.0, 0.3]) * bins), 0.5))


def enumerated(tables: FactoredTables, seen: np.ndarray) -> tuple[float, np.ndarray]:
    """Log-evidence and probabilities (T, M) of the phase of each frame given all until it, Eqs. 7a to 7f term by term."""
    first, first_bins, phases, entries, steps = (np.asarray(table, np.float64) for table in tables[:5])
    states = [(q, x) for q in range(PHASES) for x in itertools.product(range(BINS), repeat=ROTATIONS)]

    def density(x, y):
        mean = x[0] + 0.3 * x[1]
        return np.exp(-0.5 * ((y - mean) / 0.5) ** 2) / (0.5 * np.sqrt(2 * np.pi))

    def step(q, x, d, before):
        ends = steps[q, d, before].sum() == 0  # Eq. 26
        return entries[q, d, x] if ends else steps[q, d, before, x]

    forward = {s: first[s[0]] * np.prod([first_bins[s[0], d, s[1][d]] for d in range(ROTATIONS)]) for s in states}
    log_evidence, found = 0.0, []
    for number, y in enumerate(seen):
        if number:
            forward = {
                (q, x): sum(
                    mass * phases[r, q] * np.prod([step(q, x[d], d, z[d]) for d in range(ROTATIONS)])
                    for (r, z), mass in forward.items()
                )
                for q, x in states
            }
        forward = {s: mass * density(s[1], y) for s, mass in forward.items()}
        total = sum(forward.values())
        log_evidence += np.log(total)
        forward = {s: mass / total for s, mass in forward.items()}
        found.append([sum(mass for (q, _), mass in forward.items() if q == phase) for phase in range(PHASES)])
    return log_evidence, np.array(found)


def rotations_model():
    """Phase and rotations alone."""
    return StateSpaceModel(
        lambda params, inputs: first_frame(inputs.activity),
        lambda params, state, inputs: next_frame(inputs.activity, state),
        lambda params, state, inputs: observe(params, state["bins"], inputs),
    )


SEEN = np.array([0.4, 2.1, 1.2])


def run(tables, builder, **settings):
    program = rotations_model()
    inputs = [Inputs(activity=tables) for _ in range(FRAMES)]
    model = program.compile(inputs[0], {})
    filter = builder(model, **settings)
    total, phases, state = 0.0, [], None
    for number, y in enumerate(SEEN):
        data, key = model.observe({"seen": y}), jax.random.key(number)
        state, info = filter.init(key, data, inputs[number]) if state is None else filter.step(key, state, data, inputs[number])
        total += float(info.log_evidence)
        weights = np.exp(np.asarray(state.log_weights, np.float64))
        phases.append(np.bincount(np.asarray(state.particles[:, 0]).astype(int), weights, PHASES))
    return total, np.array(phases)


@pytest.mark.parametrize("seed", range(3))
def test_exact_inference_is_the_enumeration(seed):
    evidence, phases = enumerated(tiny(seed), SEEN)
    total, found = run(tiny(seed), hidden_markov_filter)
    np.testing.assert_allclose(total, evidence, rtol=1e-4)
    np.testing.assert_allclose(found, phases, atol=1e-4)


@pytest.mark.slow
def test_particles_come_near_the_enumeration():
    evidence, phases = enumerated(tiny(), SEEN)
    total, found = run(tiny(), particle_filter, num_particles=20_000)
    assert abs(total - evidence) < 5 * 2 / np.sqrt(20_000)  # relative variances of three frames' weights are below 4
    np.testing.assert_allclose(found, phases, atol=5 * np.sqrt(FRAMES * 4 * 0.25 / 20_000))


def test_a_rotation_that_ends_starts_again():
    """Rows without a successor that were left out, instead of entered, would be another model."""
    tables = tiny()
    uniform = tables._replace(entries=jnp.full_like(tables.entries, 1 / BINS))
    assert abs(enumerated(tables, SEEN)[0] - enumerated(uniform, SEEN)[0]) > 0.01
    np.testing.assert_allclose(tables.successors(jnp.array(0), jnp.array([1, 0]))[0], tables.entries[0, 0])
    np.testing.assert_allclose(tables.successors(jnp.array(0), jnp.array([1, 0]))[1], tables.steps[0, 1, 0])


@pytest.mark.parametrize(("phase", "bins"), [(0, (1, 0)), (1, (2, 2)), (1, (0, 1))])
def test_next_bins_are_drawn_with_the_probabilities_of_whole_rows(phase, bins):
    """Both where a rotation ends and where it goes on; a bin without probability is never drawn."""
    tables = tiny()
    tables = tables._replace(steps=tables.steps.at[1, 1, 1].set(jnp.array([0.25, 0.0, 0.75])))
    found = NextBins(tables, jnp.array(phase), jnp.array(bins))
    rows = np.asarray(tables.successors(jnp.array(phase), jnp.array(bins)), np.float64)
    values = np.array(list(itertools.product(range(BINS), repeat=ROTATIONS)))
    with np.errstate(divide="ignore"):
        expected = np.log(np.stack([rows[0, values[:, 0]], rows[1, values[:, 1]]], 1))
    np.testing.assert_allclose(found.log_prob(jnp.asarray(values)), expected, rtol=1e-5)
    drawn, count = np.asarray(found.sample(jax.random.key(1), (20_000,))), 20_000
    shares = np.stack([np.bincount(column, minlength=BINS) / count for column in drawn.T])
    np.testing.assert_allclose(shares, rows, atol=5 * np.sqrt(0.25 / count))
    assert (shares[rows == 0] == 0).all()


def test_a_known_start_is_weighed_with_what_was_recorded():
    """Bayes' rule over all phases and bins, the angle of a bin being uniform within it."""
    tables, angles, scale = tiny(), np.array([1.8, -0.4]), np.array([0.7, 1.1])
    found = tables.starting_from(jnp.asarray(angles), jnp.asarray(scale))
    apart = (np.asarray(bin_angles(np.arange(BINS), BINS)) - angles[:, None] + np.pi) % (2 * np.pi) - np.pi
    near = np.exp(-0.5 * apart**2 / (scale[:, None] ** 2 + (2 * np.pi / BINS) ** 2 / 12))
    joint = np.asarray(tables.first_bins, np.float64) * near
    phase = np.asarray(tables.first_phase, np.float64) * joint.sum(-1).prod(-1)
    np.testing.assert_allclose(found.first_phase, phase / phase.sum(), rtol=1e-4)
    np.testing.assert_allclose(found.first_bins, joint / joint.sum(-1, keepdims=True), rtol=1e-4, atol=1e-6)
    far = tables._replace(first_bins=jnp.zeros_like(tables.first_bins).at[..., 0].set(1.0))
    assert np.isfinite(far.starting_from(jnp.full(2, 3.0), jnp.full(2, 1e-4)).first_phase).all()


def test_a_body_goes_where_it_faces_or_stays():
    coordinates = [("root", "tx"), ("root", "ty"), ("root", "tz"), ("root", "Z"), ("knee", "X"), ("hip", "X")]
    tables = tiny()._replace(velocities=jnp.asarray([[750.0, 0.0, 0.0], [750.0, 0.0, 0.0]]))
    inputs = Inputs(
        activity=tables, start=jnp.zeros(6), start_scale=jnp.full(6, 1e-3), step_scale=jnp.asarray([1.0, 1.0, 1.0, 1e-3, 0, 0])
    )
    model = factored_motion(coordinates, lambda params, pose, inputs: numpyro.factor("seen", 0.0)).compile(inputs, {})
    keys = jax.random.split(jax.random.key(0), 4000)
    before = jnp.array([0.0, 0.0, 0.0, jnp.pi / 2, 100.0, 200.0, 300.0])  # phase, bins, heading, position
    after = np.asarray(jax.vmap(lambda key: model.sample_transition(key, before, inputs))(keys))[:, 4:]
    gone = after - np.array([100.0, 200.0, 300.0])
    moved = gone[:, 0] < -15.0  # facing along -x
    assert abs(moved.mean() - 0.5) < 5 * np.sqrt(0.25 / 4000)
    np.testing.assert_allclose(gone[moved].mean(0), [-30.0, 0.0, 0.0], atol=5 / np.sqrt(2000))
    np.testing.assert_allclose(gone[~moved].mean(0), 0.0, atol=5 / np.sqrt(2000))
    pose = pose_of_bins(coordinates)({"bins": jnp.array([1, 2]), "heading": before[3], "position": before[4:]}, tables)
    np.testing.assert_allclose(pose, [100.0, 200.0, 300.0, np.pi / 2, *bin_angles(np.array([1, 2]), BINS)], rtol=1e-6)


@pytest.mark.parametrize("rate", [25.0, 50.0, 60.0])
def test_a_body_walks_as_fast_at_every_frame_rate(rate):
    """The density of a step of 30 mm ahead, in closed form: one of two ways is the mean velocity times the frame's seconds."""
    coordinates = [("root", "tx"), ("root", "ty"), ("root", "tz"), ("root", "Z"), ("knee", "X"), ("hip", "X")]
    tables = tiny()._replace(velocities=jnp.asarray([[750.0, 0.0, 0.0], [750.0, 0.0, 0.0]]), stays=0.3)
    inputs = Inputs(activity=tables, start=jnp.zeros(6), start_scale=jnp.ones(6), step_scale=jnp.full(6, 9.0), seconds=1 / rate)
    model = factored_motion(coordinates, lambda params, pose, inputs: numpyro.factor("seen", 0.0)).compile(inputs, {})
    still, gone = (jnp.array([0.0, 1.0, 2.0, 0.0, 0.0, 900.0 * ahead, 0.0]) for ahead in (0.0, 30.0 / 900.0))
    found = float(model.log_transition(gone, still, inputs) - model.log_transition(still, still, inputs))
    density = [0.3 * np.exp(-0.5 * (y / 9) ** 2) + 0.7 * np.exp(-0.5 * ((y - 750.0 / rate) / 9) ** 2) for y in (30.0, 0.0)]
    np.testing.assert_allclose(found, np.log(density[0] / density[1]), rtol=1e-4)


def test_directions():
    np.testing.assert_allclose(turned(jnp.array([1.0, 0.0, 2.0]), jnp.array(0.0)), [0, 1, 2], atol=1e-6)  # along y
    np.testing.assert_allclose(turned(jnp.array([0.0, 1.0, 0.0]), jnp.array(0.0)), [-1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(turned(jnp.array([1.0, 0.0, 0.0]), jnp.array(np.pi / 2)), [-1, 0, 0], atol=1e-6)
