"""Bodies of 8, 30 and 34 coordinates: limits as supports, stabilisers, sizes as arrays."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from poseppl_models.bodies.anthropometry import INTERNAL, anthropometric_prior, humanoid_sizes
from poseppl_models.bodies.joint_angles import smooth_limits
from poseppl_models.bodies.limited_walk import LimitedNormal, _JointLimits, limited_walk
from poseppl_models.sminchisescu_triggs.body import superquadric_body
from poseppl_models.sminchisescu_triggs.marker_body import arm, full_body, measure, measure_arm, stiff_shoulders
from precision import precision
from scipy import integrate, stats

from poseppl.filters import particle_filter
from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import marker_positions, paper_camera
from poseppl.program import StateSpaceModel

BUILDERS = {"arm": (arm, 8), "stiff_shoulders": (stiff_shoulders, 30), "full": (full_body, 34)}
LOW, HIGH = np.array([-2.3, -np.inf, -0.2]), np.array([0.1, np.inf, np.inf])
LOC, SCALE = np.array([-0.05, 0.3, -0.2]), np.array([0.3, 0.5, 0.4])


def inputs_of(body, scale=0.05):
    dimension = body.tree.dimension
    steps = jnp.where(jnp.arange(dimension) < 3, 10.0, scale)
    camera = paper_camera((0.0, -4000.0, 900.0))
    noise = jnp.full((1, len(body.tree.marker_names)), body.noise)
    return BodyInputs(camera, noise, jnp.asarray(body.rest, float), steps, steps, body.tree)


@pytest.mark.full
def test_limited_normal_against_scipy():
    """Exact; a normal that is only cut off, not normalised, integrates to less than 1."""
    values = np.linspace(-3, 2, 41)
    with precision(np.float64):
        limited = LimitedNormal(LOC, SCALE, LOW, HIGH)
        found = np.stack([np.asarray(limited.log_prob(jnp.full(3, value))) for value in values])
        moments = np.stack([limited.mean, limited.variance], 1)
    expected = [stats.truncnorm.logpdf(values, *((LOW[k] - LOC[k]) / SCALE[k], (HIGH[k] - LOC[k]) / SCALE[k]), LOC[k], SCALE[k])
                for k in range(3)]  # fmt: skip
    np.testing.assert_allclose(found, np.stack(expected, 1), rtol=1e-9)
    for k, (mean, variance) in enumerate(moments):
        exact = stats.truncnorm((LOW[k] - LOC[k]) / SCALE[k], (HIGH[k] - LOC[k]) / SCALE[k], LOC[k], SCALE[k])
        np.testing.assert_allclose([mean, variance], [exact.mean(), exact.var()], rtol=1e-6)
    cut = integrate.quad(lambda v: stats.norm.pdf(v, LOC[0], SCALE[0]), LOW[0], HIGH[0])[0]
    assert cut < 0.7


@pytest.mark.full
def test_limited_normal_draws():
    """Means of 20,000 draws within 5 standard errors, none beyond a limit; those of the normal itself lie beyond it."""
    limited = LimitedNormal(LOC, SCALE, LOW, HIGH)
    draws = np.asarray(limited.sample(jax.random.key(0), (20_000,)), np.float64)
    assert np.all((draws >= np.float32(LOW)) & (draws <= np.float32(HIGH)))
    exact = [stats.truncnorm((LOW[k] - LOC[k]) / SCALE[k], (HIGH[k] - LOC[k]) / SCALE[k], LOC[k], SCALE[k]) for k in range(3)]
    mean, spread = np.array([(each.mean(), each.std()) for each in exact]).T
    assert np.all(np.abs(draws.mean(0) - mean) < 5 * spread / np.sqrt(20_000))
    assert abs(LOC[0] - mean[0]) > 50 * spread[0] / np.sqrt(20_000)


@pytest.mark.full
def test_limited_normal_has_gradients_beyond_its_limits():
    """A mean beyond a limit, as a recorded start may be, and infinite limits give no NaN in float32."""
    gradient = jax.grad(lambda loc: jnp.sum(LimitedNormal(loc, 1e-3, LOW, HIGH).log_prob(jnp.array([0.05, 0.3, 0.0]))))
    assert np.isfinite(gradient(jnp.array([2.0, 0.3, -5.0]))).all()


@pytest.mark.full
@pytest.mark.parametrize("kind", BUILDERS)
def test_limits_are_supports_and_the_flat_state_is_the_pose(kind):
    build, dimension = BUILDERS[kind]
    body, limits = build(), superquadric_body(kind).limits
    inputs = inputs_of(body)
    model = body.compile(inputs, body.params)
    assert model.dimension == body.tree.dimension == dimension
    low = np.concatenate(
        [np.broadcast_to(getattr(site.support, "lower_bound", -np.inf), site.shape) for site in model.sites.values()]
    )
    np.testing.assert_allclose(low, limits[:, 0], rtol=1e-6)
    assert isinstance(model.sites["elbow_r"].support, _JointLimits)
    markers = model.extras(inputs.start, inputs)["markers"]
    np.testing.assert_array_equal(markers, marker_positions(body.tree, inputs.start))
    assert np.isfinite(model.log_initial(inputs.start, inputs))
    bent = inputs.start.at[body.tree.coordinates.index(("elbow_r", "X"))].set(-0.2)
    assert model.log_initial(bent, inputs) == -np.inf


@pytest.mark.full
def test_draws_keep_to_the_limits():
    """400 steps of 0.3 rad from a straight elbow; steps of a plain walk go beyond in a tenth of the draws."""
    body, limits = arm(), superquadric_body("arm").limits
    inputs = inputs_of(body, 0.3)
    model, plain = body.compile(inputs, body.params), arm(limits="barrier").compile(inputs, body.params)
    start = jnp.clip(inputs.start, *jnp.asarray(limits, float).T)
    keys = jax.random.split(jax.random.key(1), 400)
    moved, free = (jax.jit(jax.vmap(lambda key, m=m: m.sample_transition(key, start, inputs)))(keys) for m in (model, plain))
    least, most = np.float32(limits).T
    assert np.all((moved >= least) & (moved <= most))
    assert np.mean(np.any((free < least) | (free > most), 1)) > 0.1


@pytest.mark.full
def test_stabilisers_are_the_stationary_distribution():
    """Exact: with x ~ N(mu, S^2) the next state is so, too; after a plain walk it is not."""
    steps, spread, rest = np.array([0.05, 0.2, 0.5]), 0.3, 0.4

    class Walk:
        start, start_scale, step_scale = jnp.zeros(3), jnp.ones(3), jnp.asarray(steps)

    def observation(params, state, inputs):
        numpyro.sample("seen", dist.Normal(state["x"], 1.0))

    with precision(np.float64):
        programs = limited_walk({"x": slice(0, 3)}, np.tile([-np.inf, np.inf], (3, 1)), np.full(3, spread), rest)
        model = StateSpaceModel(
            lambda p, i: programs[0](p, Walk), lambda p, s, i: programs[1](p, s, Walk), observation
        ).compile()
        mean, covariance = model.transition_moments(jnp.full(3, rest))
        slope = jax.jacrev(lambda x: model.transition_moments(x)[0])(jnp.full(3, rest))
    np.testing.assert_allclose(mean, rest, rtol=1e-12)
    slope, covariance = np.asarray(slope), np.asarray(covariance)
    after = np.diag(slope @ slope.T * spread**2 + covariance)
    np.testing.assert_allclose(after, spread**2, rtol=1e-12)
    assert np.all(spread**2 + steps**2 > 1.02 * spread**2)


@pytest.mark.full
@pytest.mark.parametrize("kind", BUILDERS)
def test_sizes_are_arrays_of_the_same_body(kind):
    """Tree and flesh of other sizes, from arrays, are those that are built of them (float32 mm), not the standard's."""
    rng = np.random.default_rng(0)
    sizes = {name: value * rng.uniform(0.9, 1.1) + rng.uniform(0, 5) for name, value in humanoid_sizes().items()}
    body, other = superquadric_body(kind), superquadric_body(kind, sizes)
    tree, flesh = body.sized_in(body.tree, body.flesh, jnp.array([sizes[name] for name in body.sizes]))
    pairs = ((tree.offsets, other.tree.offsets), (tree.marker_offsets, other.tree.marker_offsets),
             (flesh.centres, other.flesh.centres), (flesh.half_axes, other.flesh.half_axes))  # fmt: skip
    for found, expected in pairs:
        np.testing.assert_allclose(found, expected, atol=2e-3)
    assert np.abs(np.asarray(flesh.half_axes - body.flesh.half_axes)).max() > 2
    assert jax.tree.structure(tree) == jax.tree.structure(other.tree)
    with pytest.raises(ValueError, match="no size 'tail'"):
        superquadric_body(kind, {"tail": 1.0})


def test_measured_bodies():
    """Markers of a body with other limbs give its lengths back: all but the split of trunk and shoulders, which are kept."""
    made = full_body({"thigh": 460.0, "forearm": 240.0, "hip_side": 80.0, "shoulder_side": 150.0, "head": 160.0})
    found = measure({name: place[None] for name, place in zip(made.tree.marker_names, np.asarray(
        marker_positions(made.tree, jnp.asarray(made.rest, float))), strict=True)})  # fmt: skip
    for name in ("thigh", "forearm", "hip_side", "head", "shank"):
        assert abs(found[name] - made.lengths[name]) < 0.5, name
    assert abs(found["clavicle_side"] + found["shoulder_side"] - 150.0 - made.lengths["clavicle_side"]) < 0.5
    with pytest.raises(ValueError, match="no shoulder_r, elbow_r or wrist_r"):
        measure_arm({"elbow_r": np.zeros((1, 3))})


@pytest.mark.full
def test_anthropometric_prior():
    """Sizes vary with the stature: two limbs are correlated by a shared factor of 3.9 % beside 3.5 % of their own."""
    mean, covariance = anthropometric_prior(("thigh", "shank", *INTERNAL, "thigh_width"))
    relative = np.sqrt(np.diag(covariance)) / np.where(mean == 0, 1, mean)
    assert len(INTERNAL) == 8 and np.all(np.linalg.eigvalsh(covariance) > 0)
    np.testing.assert_allclose(relative[:2], np.hypot(0.039, 0.035), rtol=1e-12)
    correlation = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    np.testing.assert_allclose(correlation, 0.039**2 / (0.039**2 + 0.035**2), rtol=1e-12)
    with pytest.raises(ValueError, match="no size 'tail'"):
        anthropometric_prior(("tail",))


@pytest.mark.full
def test_a_filter_runs_within_the_limits():
    """The arm over 2 frames by a particle filter; Gaussian moments are refused with the cure, and there with a barrier."""
    body = arm()
    inputs = inputs_of(body, 0.1)
    model = body.compile(inputs, body.params)
    points = model.sample_observation(jax.random.key(0), inputs.start, inputs)["points"]
    chosen, seen = particle_filter(model, 300), model.observe({"points": points})
    state, _ = jax.jit(chosen.init)(jax.random.key(1), seen, inputs)
    state, info = jax.jit(chosen.step)(jax.random.key(2), state, seen, inputs)
    elbow = np.asarray(state.particles)[:, body.tree.coordinates.index(("elbow_r", "X"))]
    assert np.isfinite(info.log_evidence) and elbow.min() >= np.radians(-5) - 1e-6
    with pytest.raises(ValueError, match="not over the real line"):
        model.transition_moments(inputs.start, inputs)
    free = arm(limits="barrier").compile(inputs, body.params)
    assert np.isfinite(free.transition_moments(inputs.start, inputs)[0]).all()


@pytest.mark.full
def test_curvature_of_a_barrier_stands_beside_that_of_the_points():
    """Exact: the information of both is that of the points and the barrier's own Hessian; at rest the elbow is at its limit."""
    body, limits = arm(), superquadric_body("arm").limits
    inputs = inputs_of(body)
    barred, bare = (arm(limits=kind).compile(inputs, body.params) for kind in ("barrier", "none"))
    seen = barred.sample_observation(jax.random.key(0), inputs.start, inputs)["points"]
    found, points = (
        np.asarray(jax.jit(model.observation_information)(inputs.start, model.observe({"points": seen}), inputs))
        for model in (barred, bare)
    )
    own = -np.asarray(jax.hessian(lambda x: smooth_limits(limits, x))(inputs.start))
    assert own.max() > 1
    np.testing.assert_allclose(found, points + own, rtol=1e-4, atol=1e-4 * points.max())
