"""The bodytrack benchmark: its corners, its scores, and how near filters come to the best pose."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodytrack.files import read_bodytrack
from poseppl_models.bodytrack.likelihood import benchmark_score, bodytrack, limb_groups, outline_sums

from poseppl.errors import InputError
from poseppl.filters import annealed_filter, tempered_filter
from poseppl.kernels.moves import RANDOM_WALK_MOVES
from poseppl.motion.geometry.coverage import outline_corners
from poseppl.motion.geometry.flesh import parts_of
from poseppl.program import Observation

NOTHING = Observation({}, {})


@pytest.fixture(scope="module")
def folder(data_dir) -> Path:
    place = data_dir / "parsec_bodytrack" / "sequenceB_1"
    if not place.is_dir():
        pytest.skip(f"no bodytrack benchmark in {place}; set POSEPPL_DATA to the recordings")
    return place


@cache
def recording(folder):
    return read_bodytrack(folder)


@cache
def score_of(folder, every):
    """Compiled score of states (N, 31), from every sample of the benchmark or from few."""
    data = recording(folder)
    inputs, body = data.inputs(), data.body

    def score(state):
        return benchmark_score(body, state, inputs, every=every)

    return jax.jit(jax.vmap(score))


def around(data, count, seed=0):
    """States about the initial pose, spread as the benchmark spreads its first particles."""
    noise = np.random.default_rng(seed).normal(size=(count, 31))
    return jnp.asarray(data.start + data.step_scale * noise, float)


@pytest.mark.full
def test_corners_in_the_first_camera(folder):
    """Published to 0.1 px; so is the tolerance, rounding included."""
    data = recording(folder)
    batch = jax.tree.map(lambda leaf: leaf[..., None], (data.cameras, data.body.flesh, data.body.tree))
    cameras, flesh, tree = batch
    corners = outline_corners(cameras, flesh, parts_of(tree, flesh, jnp.asarray(data.start, float)[:, None]))[0, ..., 0]
    for part, expected in {
        0: [(265.7, 304.0), (301.4, 386.3), (352.7, 360.8), (312.8, 280.4)],
        2: [(278.5, 248.6), (271.5, 206.4), (249.2, 209.5), (254.2, 252.1)],
        9: [(307.7, 374.9), (317.7, 419.3), (347.7, 412.2), (336.5, 368.1)],
    }.items():
        np.testing.assert_allclose(corners[part], expected, atol=0.07)


@pytest.mark.full
def test_scores_of_the_benchmark(folder):
    """Its own figures, to their four digits, with as many samples as an independent port counts."""
    data = recording(folder)
    expected = {"start": (-0.3068, 899), "reference": (-0.2945, 897)}
    for name, state in (("start", data.start), ("reference", data.reference[0])):
        state = jnp.asarray(state, float)
        sums = outline_sums(data.body, state, data.inputs(), every=True)
        assert (float(jnp.sum(sums.num_edge)), float(jnp.sum(sums.num_inside))) == (expected[name][1], 1076)
        assert float(benchmark_score(data.body, state, data.inputs(), every=True)) == pytest.approx(expected[name][0], abs=5e-5)
        flipped = data._replace(edge_maps=data.edge_maps[:, :, ::-1], foregrounds=data.foregrounds[:, :, ::-1]).inputs()
        wrong = benchmark_score(data.body, state, flipped, every=True)
        assert float(wrong) < -0.8  # rows the other way round: people are not where they were


@pytest.mark.slow
def test_few_samples_stand_for_all(folder):
    """Over poses spread as the first particles are: an rms error of 0.003, while the score itself varies by 0.04."""
    states = around(recording(folder), 2000)
    every, few = (np.asarray(score_of(folder, every)(states), float) for every in (True, False))
    assert np.sqrt(np.mean((few - every) ** 2)) < 0.004
    assert abs(np.mean(few - every)) < 0.002
    assert np.corrcoef(few, every)[0, 1] > 0.996
    assert every.std() > 0.02


def test_poses_and_states_round_trip(folder):
    body = recording(folder).body
    poses = np.random.default_rng(0).normal(size=(4, 5, 31))
    np.testing.assert_array_equal((body.state_of(poses) * body.signs)[..., np.argsort(body.order)], poses)
    assert sorted(body.order) == list(range(31)) and set(np.abs(body.signs)) == {1.0}
    np.testing.assert_allclose(recording(folder).start[:3], [134.693, 940.095, 867.287])


@pytest.mark.full
def test_limbs_are_all_coordinates(folder):
    body = recording(folder).body
    groups = limb_groups(body)
    assert sorted(sum(groups, [])) == list(range(31)) and [len(group) for group in groups] == [6, 4, 4, 2, 6, 6, 3]
    for group in groups:
        sides = {body.tree.coordinates[i][0][-2:] for i in group} & {"_l", "_r"}
        assert len(sides) <= 1
    names = bodytrack(body).compile(params={"beta": 1.0}, inputs=recording(folder).inputs()).coordinate_names
    for (joint, _), name in zip(body.tree.coordinates, names, strict=True):
        assert name.startswith(joint)  # a filter's coordinates are in the tree's order


def estimates(folder, **settings):
    """Every-sample scores of weighted means and of best particles (10, 2) over ten seeds, and evaluations of one run."""
    data = recording(folder)
    every = settings.pop("every")
    model = bodytrack(data.body, every=every).compile(params={"beta": 1.0}, inputs=data.inputs())
    init = jax.jit(annealed_filter(model, **settings).init)
    rows = []
    for seed in range(10):
        state, info = init(jax.random.key(seed), NOTHING, data.inputs())
        mean = jnp.exp(state.log_weights) @ state.particles
        rows.append(np.asarray(score_of(folder, True)(jnp.stack([mean, state.best])), float))
    return np.array(rows), int(info.num_likelihood)


@pytest.mark.slow
def test_annealing_is_as_good_as_the_benchmarks(folder):
    """1,000 particles, 5 layers: the benchmark's own estimates score -0.2972 +- 0.0020 (sd) over ten seeds.

    Monte Carlo: means over ten seeds have a standard error of 0.0006, 5 of which would be -0.2958 -+ 0.003.
    """
    found, evaluations = estimates(folder, num_particles=1000, num_layers=5, every=True)
    assert evaluations == 5000
    assert found[:, 0].mean() > -0.297
    one, _ = estimates(folder, num_particles=1000, num_layers=1, every=True)
    assert one[:, 0].mean() < -0.297  # without layers it is not


@pytest.mark.slow
def test_crossing_limbs_finds_better_poses_with_as_many_evaluations(folder):
    """20 layers of 250 particles that inherit limbs: -0.2827 +- 0.0024 (sd), a standard error of 0.0008 over ten seeds."""
    groups = limb_groups(recording(folder).body)
    settings = {"num_particles": 250, "num_layers": 20, "survival": 0.5, "every": True}
    found, evaluations = estimates(folder, crossover=groups, **settings)
    assert evaluations == 5000
    assert found[:, 0].mean() > -0.285
    plain, _ = estimates(folder, **settings)
    assert plain[:, 0].mean() < found[:, 0].mean() - 0.002


@pytest.mark.slow
def test_the_posterior_at_a_fixed_temperature(folder):
    """A sampler of the posterior agrees with importance sampling from the prior; annealing, which is none, does not.

    Monte Carlo: within 5 standard errors of the difference, from replicates, for the evidence and for the mean score. At
    beta = 100 half a million draws from the prior are worth tens of thousands from the posterior.
    """
    data, beta, score = recording(folder), 100.0, score_of(folder, False)
    prior = np.concatenate([np.asarray(score(around(data, 65_536, seed)), float).reshape(4, -1) for seed in range(4)])
    weights = np.exp(beta * (prior - prior.max()))
    evidences = beta * prior.max() + np.log(weights.mean(1))
    means = np.sum(weights * prior, 1) / weights.sum(1)
    model = bodytrack(data.body).compile(params={"beta": beta}, inputs=data.inputs())
    tempered = jax.jit(tempered_filter(model, 1000, moves=RANDOM_WALK_MOVES).init)
    found = []
    for seed in range(8):
        state, info = tempered(jax.random.key(seed), NOTHING, data.inputs())
        found.append((float(info.log_evidence), float(score(state.particles).mean())))
    for values, expected in zip(np.transpose(found), (evidences, means), strict=True):
        error = np.hypot(values.std(ddof=1) / np.sqrt(len(values)), expected.std(ddof=1) / np.sqrt(len(expected)))
        assert abs(values.mean() - expected.mean()) < 5 * error
    annealed, _ = annealed_filter(model, 1000).init(jax.random.key(0), NOTHING, data.inputs())
    off = float(jnp.exp(annealed.log_weights) @ score(annealed.particles)) - means.mean()
    assert off > 20 * error


def copy_of(folder, place):
    """The folder with links to its files, to be spoiled."""
    for source in folder.rglob("*"):
        target = place / source.relative_to(folder)
        if source.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            target.symlink_to(source)
    return place


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("InitialPose.txt", "1 2 3\n", "InitialPose.txt: 3 numbers .expected 31"),
        ("BodyShapeParameters.txt", "1\n" * 57, "57 numbers .expected 58"),
        ("PoseParameters.txt", "0.1\n" * 92 + "x\n", "line 93: 'x' is not a number"),
        ("poses_reference_apf.txt", "0 " * 31 + "\n" + "0 " * 30, "pose 2 has 30 numbers"),
        ("CALIB/Camera2.cal", "1\n" * 25, "Camera2.cal: a skew"),
        ("CALIB/Camera3.cal", "1\n" * 4 + "0\n" * 21, "Camera3.cal: no camera"),
        ("CAM4/image0000.bmp", "BM", "image0000.bmp, camera 4, frame 0: cannot be decoded"),
        ("FG1/image0000.bmp", None, "FG1.image0000.bmp: no such file"),
    ],
)
def test_files_that_cannot_be_used(folder, tmp_path, name, text, words):
    spoiled = copy_of(folder, tmp_path / "copy") / name
    spoiled.unlink()
    if text is not None:
        spoiled.write_text(text)
    with pytest.raises(InputError, match=words):
        read_bodytrack(tmp_path / "copy")


@pytest.mark.full
def test_folders_that_cannot_be_used(folder, tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        read_bodytrack(tmp_path / "absent")
    with pytest.raises(InputError, match="image0007.bmp: no such file"):
        read_bodytrack(folder, frames=(0, 7))
    with pytest.raises(InputError, match="nothing to read"):
        read_bodytrack(folder, frames=())
