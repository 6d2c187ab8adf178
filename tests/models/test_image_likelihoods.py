"""Each published likelihood against plain NumPy on small images, best at the true pose, blind where it should be."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from image_scenes import HEIGHT, STRIDE, WIDTH, cameras, edges, masks, outlines, true_pose
from oracles.plain_outlines import distance_to_sides, inside_samples, nearest_mean, side_samples
from poseppl_models.bodies.cone_body import ConeBody
from poseppl_models.darby import body as darby_likelihood
from poseppl_models.darby.body import darby_body
from poseppl_models.du_guan import evidence as du_guan_evidence
from poseppl_models.du_guan.likelihood import du_guan_body
from poseppl_models.images.evidence import two_way_evidence
from poseppl_models.images.image_program import ImageInputs, camera_likelihood, image_program
from poseppl_models.images.silhouette_bits import pack_mask
from poseppl_models.peursum import body as peursum_likelihood
from poseppl_models.peursum.body import peursum_body
from precision import precision
from scipy.ndimage import gaussian_filter

from poseppl.motion.vision import colour_histogram

PARAMS = {"lambda": 10.0, "beta": 10.0, "gamma": 5.0, "overlap_scale": 2.0, "colour_scale": 0.3, "boundary_scale": 0.3}
TOLERANCE = 3.0
BATCH = 64
EXACT = 1e-9
"""Both sides are float64 sums of a thousand terms, but the oracle differentiates rings by differences, good to 1e-9."""


@pytest.fixture(scope="module", autouse=True)
def _double():
    with precision(np.float64):
        yield


def occluder():
    """A table before the legs in the first camera, a pillar at the side of the second."""
    known = np.ones((3, HEIGHT, WIDTH), bool)
    known[0, 80:95, 60:110] = False
    known[1, :, 84:90] = False
    return known


def inputs(body, evidence, weights=(1.0, 1.0, 1.0)):
    zeros = jnp.zeros(body.tree.dimension)
    return ImageInputs(cameras(), jnp.array(weights), evidence, zeros, zeros + 1.0, zeros + 1.0)


def two_way(body, known=None):
    state, view = true_pose(body), cameras()
    there = np.ones((3, HEIGHT, WIDTH), bool) if known is None else known
    shown, lines = masks(body, state, view), edges(body, state, view)
    near = np.stack([np.exp(-0.5 * (gaussian_filter(1.0 - line, 1.0) * 2) ** 2) for line in lines])
    soft = np.stack([gaussian_filter(mask.astype(float), 1.0) for mask in shown])
    return two_way_evidence(shown, lines, there, stride=STRIDE, inside_error=(1 - soft) ** 2, edge_error=(1 - near) ** 2)


def du_guan(body, known=None):
    """Each part in a colour of its own, by a coarse painting: bins are stripes of the image inside of the silhouette."""
    state, view = true_pose(body), cameras()
    there = np.ones((3, HEIGHT, WIDTH), bool) if known is None else known
    shown = masks(body, state, view)
    stripes = np.add.outer(np.arange(HEIGHT) // 12, np.arange(WIDTH) // 40)
    bins = np.where(shown, stripes[None], 15)
    colours = du_guan_evidence.part_colours(body, state, view, du_guan_evidence.pad_bins(bins, there), 16)
    weights = np.broadcast_to(np.linspace(1.0, 2.0, colours.shape[1]), colours.shape[:2])
    return du_guan_evidence.du_guan_evidence(shown, there, bins, colours, weights, stride=STRIDE)


def fraction(part, whole):
    return 1 - part.sum() / whole.sum() if whole.any() else 0.0


def plain_means(body, state, values, known, empty, samples, *grid):
    """Mean errors at samples of the parts (C,)."""
    means = []
    for c, parts in enumerate(outlines(body, state, cameras())):
        points, weights = zip(*(samples(corners, *grid) for corners in parts), strict=True)
        means.append(nearest_mean(np.asarray(values)[c, :-1], known[c], np.concatenate(points), np.concatenate(weights), empty))
    return np.array(means)


def plain_inside(body, state, evidence, known, empty):
    return plain_means(body, state, evidence.inside_error, known, empty, inside_samples, *darby_likelihood.GRID)


def plain_sides(body, state, evidence, known, empty):
    return plain_means(body, state, evidence.edge_error, known, empty, side_samples, darby_likelihood.SIDE_SAMPLES)


def plain_peursum(body, state, evidence, known):
    """Log P summed over cameras, term by term as in the module's head."""
    view, grid = cameras(), (slice(None), slice(STRIDE // 2, None, STRIDE), slice(STRIDE // 2, None, STRIDE))
    there = known[grid]
    claimed = masks(body, state, view, STRIDE) & there
    shown = masks(body, true_pose(body), view)[grid] & there
    edge_body = plain_sides(body, state, evidence, known, 0.0)
    total = 0.0
    for c, parts in enumerate(outlines(body, state, view)):
        kept = np.asarray(evidence.edge_weights[c]) > 0
        missed = [distance_to_sides(point, parts) > TOLERANCE for point in np.asarray(evidence.edge_points[c])[kept]]
        both = claimed[c] & shown[c]
        terms = edge_body[c] + np.mean(missed) + fraction(both, claimed[c]) + fraction(both, shown[c])
        total += np.log(PARAMS["lambda"]) - PARAMS["lambda"] * terms / 2
    return total


def plain_darby(body, state, evidence, known):
    sums = plain_sides(body, state, evidence, known, 1.0) + plain_inside(body, state, evidence, known, 1.0)
    return -PARAMS["beta"] * np.sum(sums)


def plain_monocular(body, state, evidence, known):
    grid = (slice(None), slice(STRIDE // 2, None, STRIDE), slice(STRIDE // 2, None, STRIDE))
    there = known[grid]
    total = 0.0
    for c, error in enumerate(plain_inside(body, state, evidence, known, 1.0)):
        sizes = [
            np.sum(mask[c] & there[c])
            for mask in (masks(body, true_pose(body), cameras())[grid], masks(body, state, cameras(), STRIDE))
        ]
        image, model = (size / (there[c].sum() - size) for size in sizes)
        total -= PARAMS["beta"] * error / (1 - abs(image - model) / max(image, model)) ** PARAMS["gamma"]
    return total


def plain_du_guan(body, state, evidence, known):
    """Histograms are counted, and the boundary is that of the grid's own mask."""
    view, grid = cameras(), (slice(None), slice(STRIDE // 2, None, STRIDE), slice(STRIDE // 2, None, STRIDE))
    there = known[grid]
    claimed, shown = masks(body, state, view, STRIDE) & there, masks(body, true_pose(body), view)[grid] & there
    bins = np.asarray(evidence.bins)[:, :-1]
    described = du_guan_evidence.grid_descriptors(pack_mask(claimed, 1)[..., None])[..., 0]
    boundary = np.linalg.norm(np.asarray(described) - np.asarray(evidence.descriptors), axis=1)
    total = 0.0
    for c, parts in enumerate(outlines(body, state, view)):
        histograms = []
        for corners in parts:
            points, _ = inside_samples(corners, *du_guan_evidence.GRID)
            at = [(int(np.floor(y + 0.5)), int(np.floor(x + 0.5))) for x, y in points]
            found = np.array([bins[c, y, x] for y, x in at if 0 <= y < HEIGHT and 0 <= x < WIDTH and known[c, y, x]], int)
            histograms.append(np.bincount(found, minlength=16) / max(len(found), 1))
        seen = np.array([histogram.sum() > 0 for histogram in histograms])
        weights = np.where(seen, np.asarray(evidence.part_weights[c]), 0.0)
        overlaps = np.sqrt(np.array(histograms) * np.asarray(evidence.colours[c])).sum(-1)
        colour = np.sqrt(max(1 - weights @ overlaps / weights.sum(), 0))
        overlap = np.sum(claimed[c] & shown[c]) / np.sum(claimed[c] | shown[c])
        total += (
            np.log(overlap) / PARAMS["overlap_scale"] - colour / PARAMS["colour_scale"] - boundary[c] / PARAMS["boundary_scale"]
        )
    return total


def rows():
    from poseppl_models.du_guan.likelihood import du_guan_score

    return {
        "peursum": (peursum_body(), peursum_likelihood.peursum_score(STRIDE, TOLERANCE), two_way, plain_peursum),
        "darby": (darby_body(), darby_likelihood.darby_score(), two_way, plain_darby),
        "monocular": (darby_body(), darby_likelihood.darby_monocular_score(STRIDE), two_way, plain_monocular),
        "du_guan": (du_guan_body(), du_guan_score(STRIDE), du_guan, plain_du_guan),
        "smooth_peursum": (peursum_body(), peursum_likelihood.smooth_peursum_score(), two_way, None),
        "smooth_darby": (darby_body(), darby_likelihood.darby_score(smooth=True), two_way, None),
    }


NAMES = ("peursum", "darby", "monocular", "du_guan", "smooth_peursum", "smooth_darby")
SMOOTH = ("smooth_peursum", "smooth_darby")


class Entry(NamedTuple):
    body: ConeBody
    plain: Any
    evaluate: Any
    gradient: Any
    clear: Any
    occluded: Any


@pytest.fixture(scope="module")
def catalogue(_double):
    """Each likelihood with its images, made and compiled once, for batches that are filled up to one size."""
    built = {}
    for name, (body, score, images, plain) in rows().items():
        likelihood = camera_likelihood(body, score)
        compiled = jax.jit(lambda states, frame, f=likelihood: jax.vmap(lambda x: f(PARAMS, x, frame))(states))
        gradient = jax.jit(jax.grad(lambda x, frame, f=likelihood: f(PARAMS, x, frame)))

        def evaluate(states, frame, compiled=compiled):
            filled = np.concatenate([states, np.repeat(states[-1:], BATCH - len(states), 0)])
            return np.asarray(compiled(jnp.asarray(filled), frame))[: len(states)]

        built[name] = Entry(body, plain, evaluate, gradient, images(body), images(body, occluder()))
    return built


def perturbed(body, count, seed=0):
    rng = np.random.default_rng(seed)
    scale = np.where(np.arange(body.tree.dimension) < 3, 60.0, 0.25)
    return true_pose(body) + scale * rng.normal(size=(count, body.tree.dimension))


@pytest.mark.full
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name == "peursum" else ()) for name in NAMES if name not in SMOOTH]
)
def test_equals_plain_numpy(catalogue, name):
    """At the true pose and near it, behind occluders."""
    body, plain, evaluate, _, _, evidence = catalogue[name]
    states = np.concatenate([true_pose(body)[None], perturbed(body, 1)])
    found = evaluate(states, inputs(body, evidence))
    for value, state in zip(found, states, strict=True):
        # a colour distance of 0 is the root of a rounding error, 1e-8, over a scale of 0.3
        np.testing.assert_allclose(value, plain(body, state, evidence, occluder()), rtol=EXACT, atol=2e-7)


@pytest.mark.full
@pytest.mark.parametrize("name", NAMES)
def test_highest_near_the_truth(catalogue, name):
    """Above all of 60 poses that are off by 60 mm and 0.25 rad in every coordinate."""
    entry = catalogue[name]
    states = np.concatenate([true_pose(entry.body)[None], perturbed(entry.body, 60)])
    found = entry.evaluate(states, inputs(entry.body, entry.clear))
    assert np.all(np.isfinite(found)) and np.argmax(found) == 0
    assert found[0] - np.median(found[1:]) > 5.0  # temperatures of 0.1 to 0.3 tell poses apart by more than e^5


@pytest.mark.full
@pytest.mark.parametrize("name", NAMES)
def test_cameras_multiply_and_drop_out(catalogue, name):
    """Weights add cameras up, and what a camera of weight 0 holds changes nothing at all."""
    body, _, evaluate, _, evidence, _ = catalogue[name]
    states = perturbed(body, 3)
    alone = [evaluate(states, inputs(body, evidence, np.eye(3)[c])) for c in range(3)]
    np.testing.assert_allclose(evaluate(states, inputs(body, evidence)), sum(alone), rtol=1e-12)
    spoilt = jax.tree.map(lambda leaf: leaf.at[2].set(jnp.nan if jnp.issubdtype(leaf.dtype, jnp.floating) else 7), evidence)
    two = evaluate(states, inputs(body, spoilt, (1.0, 1.0, 0.0)))
    np.testing.assert_array_equal(two, evaluate(states, inputs(body, evidence, (1.0, 1.0, 0.0))))


@pytest.mark.full
@pytest.mark.parametrize("name", ["peursum", "monocular", "du_guan"])
def test_what_is_hidden_is_no_evidence(catalogue, name):
    """Masks that differ only behind the occluder give the same value; maps mark it already."""
    body, _, evaluate, _, _, evidence = catalogue[name]
    states = perturbed(body, 2)
    changed = evidence._replace(foreground=evidence.foreground ^ ~evidence.known)
    np.testing.assert_array_equal(evaluate(states, inputs(body, changed)), evaluate(states, inputs(body, evidence)))


@pytest.mark.full
@pytest.mark.parametrize("name", [pytest.param("smooth_peursum", marks=pytest.mark.slow), "smooth_darby"])
def test_gradient_against_differences(catalogue, name):
    """Central differences of 1e-7 mm and rad: of the kinks where a sample crosses a pixel, 0.02 are met."""
    body, _, evaluate, gradient_of, evidence, _ = catalogue[name]
    frame, state, step = inputs(body, evidence), perturbed(body, 1)[0], 1e-7
    gradient = np.asarray(gradient_of(jnp.asarray(state), frame))
    moved = np.concatenate([state + step * np.eye(len(state)), state - step * np.eye(len(state))])
    values = evaluate(moved, frame)
    differences = (values[: len(state)] - values[len(state) :]) / (2 * step)
    # cancellation: 1e-15 of a value of 60, over the step, is 1e-6
    np.testing.assert_allclose(gradient, differences, rtol=1e-4, atol=1e-5 * np.abs(gradient).max())


@pytest.mark.full
def test_programs_compile(catalogue):
    """As a state-space model: a density of the images through a factor, and the walk."""
    body = peursum_body()
    frame = inputs(body, catalogue["peursum"].clear)
    program = image_program(body, peursum_likelihood.peursum_score(STRIDE, TOLERANCE))
    model = program.compile(frame, {"lambda": jnp.asarray(10.0)})
    assert model.dimension == 28
    state = jnp.asarray(true_pose(body))
    found = model.log_observation(state, model.observe({}), frame)
    expected = plain_peursum(body, true_pose(body), frame.evidence, np.ones((3, HEIGHT, WIDTH), bool))
    np.testing.assert_allclose(found, expected, rtol=EXACT)


@pytest.mark.full
def test_a_coarser_grid_says_nearly_the_same():
    """At stride 4 in images as small as these, where limbs are 6 to 10 px wide, log P is within 4% of that of every pixel."""
    body = peursum_body()
    shown = masks(body, true_pose(body), cameras())
    lines, there = edges(body, true_pose(body), cameras()), np.ones((3, HEIGHT, WIDTH), bool)
    states = jnp.asarray(perturbed(body, 8))
    found = []
    for stride in (1, 4):
        likelihood = camera_likelihood(body, peursum_likelihood.peursum_score(stride, TOLERANCE))
        frame = inputs(body, two_way_evidence(shown, lines, there, stride=stride))
        found.append(np.asarray(jax.jit(jax.vmap(lambda x, f=likelihood, i=frame: f(PARAMS, x, i)))(states)))
    np.testing.assert_allclose(found[1], found[0], rtol=0.04)


@pytest.mark.full
def test_colours_need_no_histogram():
    """The sum over pixels is the overlap of counted histograms."""
    rng = np.random.default_rng(0)
    bins, sought = rng.integers(0, 5, 24), rng.dirichlet(np.ones(5))
    counted = np.sum(np.sqrt(colour_histogram(bins[None])[:5] * sought))
    number = np.array([np.sum(bins == b) for b in bins])
    np.testing.assert_allclose(np.sum(np.sqrt(sought[bins] / (24 * number))), counted, rtol=1e-12)
