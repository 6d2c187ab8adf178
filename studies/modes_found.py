"""How many modes of a pose are found for a number of likelihood evaluations, by where the search starts.

    python -m studies.modes_found [--quick] [--poses 6] [--starts 10000] [--folder DIR]

The body is that of Choo and Fleet, with 28 coordinates. One camera at 5 m sees its 17 points with noise of 0.003 of the focal
length. Joint limits are bounds, and the prior is around the pose at rest (1 rad, 300 mm a standard deviation). Poses are random
ones within the limits, 0.4 rad from rest. Modes count that have at least e^-7 of the heaviest mode's mass. The reference is the
set of modes that any method finds, or --starts climbs from draws of the prior. Each method starts, as a tracker would, from the
mode at the end of a climb from the truth, with that mode's covariance (Sminchisescu and Triggs 2001, section 4.2 and Fig. 5):

* dynamic noise: N(mu, s Q) with Q of 15 mm and 0.15 rad, s = 1 and 10;
* multiple hypothesis tracking: N(mu, S + s Q), S being the covariance of the mode, s = 1 and 10;
* covariance scaled: s = 10 (or 40) on the k = 6, 12 or all 28 most uncertain axes, regular or random;
* kinematic jumps: each limb leaning the other way, and of these poses again those of the other limbs;
* half jumps, half covariance scaled.

An evaluation is one of likelihood, gradient and Gauss-Newton curvature together. Prints a table; --folder gets modes_found.csv,
a row for each pose, method and number of starts, its record in tables.json, and modes_found.png. Poses that the table there
has, with as many starts, are not computed again.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
from poseppl_models.bodies.choo_fleet import full_body
from poseppl_models.bodies.joint_angles import joint_limits
from poseppl_papers.tables import Kept, Provenance, Table, read_folder, write_folder

from benchmarks.timing import show
from poseppl.jobs.job import versions
from poseppl.kernels.constraints import Constraints, constraints
from poseppl.kernels.face_laplace import FaceModes, face_modes
from poseppl.kernels.mode_search import covariance_scaled, dynamic_noise
from poseppl.kernels.trust_region import climb_modes
from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import marker_positions
from poseppl.motion.geometry.cameras import look_at, project
from poseppl.motion.geometry.kinematic_jumps import kinematic_jumps
from poseppl.program import CompiledModel, Observation

PRIOR_ANGLE, PRIOR_POSITION = 1.0, 300.0
POSE_ANGLE = 0.4
STEP_ANGLE, STEP_POSITION = 0.15, 15.0
NOISE = 0.003
LEAST = 7.0
"""Log of the ratio of masses below which a mode does not count."""
BATCH = 200
NUM_STEPS = 120
COLUMNS = ("pose", "method", "starts", "evaluations", "modes", "of", "mass")
ABOUT = (
    "Modes of a pose that one camera sees, found from the mode next to the truth, of those that {starts:,} draws of the prior "
    "or any method came to; share of their mass; evaluations of likelihood, gradient and curvature."
)
Floats = np.ndarray[Any, Any]


class Posed(NamedTuple):
    """One pose: model, inputs, data, joint limits, the true state and the units of a step (d,)."""

    model: CompiledModel
    inputs: BodyInputs
    data: Observation
    limits: Constraints
    truth: jax.Array
    units: jax.Array


class Climbed(NamedTuple):
    """Modes that climbs ended in, and evaluations of each (S,)."""

    modes: FaceModes
    evaluations: Floats


def pose_problem(seed: int) -> Posed:
    """A random pose within the joint limits, its image, and the prior."""
    body, rng = full_body(), np.random.default_rng(seed)
    rest, tree = np.asarray(body.rest), body.tree
    low, high = joint_limits(tree).T
    low, high = np.minimum(low, rest - 0.05), np.maximum(high, rest + 0.05)
    of_step, of_prior = (np.r_[np.full(3, a), np.full(len(rest) - 3, b)] for a, b in (STEPS, PRIORS))
    truth = rest + np.r_[np.zeros(3), POSE_ANGLE * rng.normal(size=len(rest) - 3)]
    truth = np.clip(truth, low + 0.05, high - 0.05)
    camera = look_at((0.0, -5000.0, 1000.0), (0.0, 0.0, 900.0))
    noise = jnp.full((1, len(tree.marker_names)), NOISE)
    inputs = BodyInputs(camera, noise, *(jnp.asarray(part, jnp.float32) for part in (rest, of_prior, of_step)), tree)
    model = body.compile(inputs, body.params)
    points = np.asarray(project(camera, marker_positions(tree, jnp.asarray(truth, jnp.float32))))
    data = model.observe({"points": points + NOISE * rng.normal(size=points.shape)})
    limits = constraints(len(rest), lower=low, upper=high)
    return Posed(model, inputs, data, limits, jnp.asarray(truth, jnp.float32), jnp.asarray(of_step, jnp.float32))


STEPS, PRIORS = (STEP_POSITION, STEP_ANGLE), (PRIOR_POSITION, PRIOR_ANGLE)


@partial(jax.jit, static_argnums=0)
def climb_batch(model: CompiledModel, starts: jax.Array, data: Observation, inputs: BodyInputs, limits: Constraints) -> Any:
    """Climb from a batch of starts."""
    precision = jnp.diag(1.0 / inputs.start_scale**2)
    climbs = climb_modes(
        starts,
        lambda x: model.log_initial(x, inputs) + model.log_observation(x, data, inputs),
        lambda x: precision + model.observation_information(x, data, inputs),
        limits,
        units=inputs.step_scale,
        num_steps=NUM_STEPS,
        tolerance=1e-3,
    )
    return face_modes(climbs, limits), climbs.evaluations


def climb(posed: Posed, starts: Floats) -> Climbed:
    """Climb from any number of starts, in batches of one size."""
    missing = -len(starts) % BATCH
    filled = np.concatenate([starts, np.repeat(starts[-1:], missing, 0)])
    parts = [
        climb_batch(posed.model, jnp.asarray(batch, jnp.float32), posed.data, posed.inputs, posed.limits)
        for batch in filled.reshape(-1, BATCH, filled.shape[1])
    ]
    modes, evaluations = jax.tree.map(
        lambda *leaves: np.concatenate([np.asarray(leaf) for leaf in leaves])[: len(starts)], *parts
    )
    return Climbed(modes, evaluations)


class Known(NamedTuple):
    """Distinct modes so far, the heaviest first: states (K, d), precisions (K, d, d), log-masses (K,)."""

    states: Floats
    precisions: Floats
    log_masses: Floats


def distinct(modes: FaceModes, known: Known | None = None) -> Known:
    """Modes that are not those of a heavier climb, by either's own covariance, and heavy enough to count."""
    parts = [np.asarray(part, float) for part in (modes.states, modes.precisions, modes.log_masses)]
    if known is not None:
        parts = [np.concatenate([one, other]) for one, other in zip(known, parts, strict=True)]
    states, precisions, masses = parts
    order = [i for i in np.argsort(-masses) if masses[i] > masses.max() - LEAST]
    kept: list[int] = []
    for index in order:
        if not kept or not same_mode(states[index], precisions[index], states[kept], precisions[kept]).any():
            kept.append(index)
    return Known(states[kept], precisions[kept], masses[kept])


def same_mode(state: Floats, precision: Floats, others: Floats, precisions: Floats) -> Floats:
    """Whether a mode is one of others (K,): within a standard deviation of both."""
    offset = others - state
    own, theirs = np.einsum("ki,ij,kj->k", offset, precision, offset), np.einsum("ki,kij,kj->k", offset, precisions, offset)
    return np.maximum(own, theirs) < 1.0


def found_among(modes: FaceModes, truth: Known) -> Floats:
    """Which of the true modes (K,) some climb ended in."""
    found = np.zeros(len(truth.states), bool)
    for state, precision in zip(np.asarray(modes.states, float), np.asarray(modes.precisions, float), strict=True):
        found |= same_mode(state, precision, truth.states, truth.precisions)
    return found


def jumped(posed: Posed, mode: Floats, number: int) -> Floats:
    """Poses by kinematic jumps: of single limbs, and from those of the other limbs, nearest first in the number of jumps."""
    jump = jax.jit(jax.vmap(lambda x: kinematic_jumps(posed.inputs.tree)(x, posed.inputs)))
    poses = np.asarray(jump(jnp.asarray(mode, jnp.float32)[None]))[0]
    for _ in range(3):
        if len(poses) >= number:
            break
        again = np.asarray(jump(jnp.asarray(poses, jnp.float32))).reshape(-1, poses.shape[1])
        everything = np.concatenate([poses, again])
        changed = np.round(np.concatenate([everything, mode[None]]), 3)
        first = np.sort(np.unique(changed[:-1], axis=0, return_index=True)[1])
        poses = everything[[i for i in first if (changed[i] != changed[-1]).any()]]
    return poses[:number]


def methods(posed: Posed, mode: Floats, covariance: Floats) -> Mapping[str, Callable[[int], Floats]]:
    """Starts of each method, as many as asked for."""
    noise, state, spread = jnp.diag(posed.units**2), jnp.asarray(mode, jnp.float32), jnp.asarray(covariance, jnp.float32)

    def sampled(proposal: Callable[..., Any], *args: Any, **settings: Any) -> Callable[[int], Floats]:
        return lambda number: np.asarray(proposal(number, *args, **settings)(jax.random.key(number), state, spread))

    scaled = partial(sampled, covariance_scaled, posed.units)
    half = scaled(num_directions=12)
    return {
        "dynamic noise": sampled(dynamic_noise, noise),
        "dynamic noise, s = 10": sampled(dynamic_noise, noise, stretch=10.0),
        "multiple hypotheses": sampled(dynamic_noise, noise, spread=True),
        "multiple hypotheses, s = 10": sampled(dynamic_noise, noise, stretch=10.0, spread=True),
        "covariance scaled, 6 axes": scaled(num_directions=6),
        "covariance scaled, 12 axes": half,
        "covariance scaled, 12 axes, s = 40": scaled(num_directions=12, stretch=40.0),
        "covariance scaled, 12 axes, random": scaled(num_directions=12, pattern="random"),
        "covariance scaled, 28 axes, random": scaled(num_directions=28, pattern="random"),
        "kinematic jumps": lambda number: jumped(posed, mode, number),
        "jumps and covariance scaled": lambda number: _in_turns(jumped(posed, mode, number), half(number))[:number],
    }


def _in_turns(one: Floats, other: Floats) -> Floats:
    """The rows of two arrays in turns, as far as both go."""
    count = min(len(one), len(other))
    return np.stack([one[:count], other[:count]], 1).reshape(-1, one.shape[1])


def study(pose: int, num_starts: int, counts: Sequence[int]) -> list[tuple[Any, ...]]:
    """All rows of one pose."""
    posed, begun = pose_problem(pose), time.perf_counter()
    own = climb(posed, np.asarray(posed.truth)[None])
    mode, covariance = np.asarray(own.modes.states[0], float), np.asarray(own.modes.moments()[1][0], float)
    prior = np.asarray(posed.inputs.start) + np.asarray(posed.inputs.start_scale) * np.random.default_rng(1).normal(
        size=(num_starts, len(mode))
    )
    searched = climb(posed, prior)
    truth = distinct(searched.modes, distinct(own.modes))
    results = {}
    for name, propose in methods(posed, mode, covariance).items():
        starts = propose(counts[-1])
        results[name] = climb(posed, starts)
        truth = distinct(results[name].modes, truth)
    weights = np.exp(truth.log_masses - truth.log_masses.max())
    print(f"pose {pose}: {len(truth.states)} modes, {time.perf_counter() - begun:.0f} s", flush=True)
    rows: list[tuple[Any, ...]] = []
    for name, climbed in [*results.items(), ("draws of the prior", searched)]:
        for count in [*counts, *([num_starts] if name == "draws of the prior" else [])]:
            modes = jax.tree.map(lambda leaf, count=count: leaf[:count], climbed.modes)
            found = found_among(modes, truth) | found_among(own.modes, truth)
            spent = int(climbed.evaluations[:count].sum())
            used = min(count, len(climbed.evaluations))
            rows.append((pose, name, used, spent, int(found.sum()), len(found), float(weights @ found / weights.sum())))
    return rows


def draw(table: Table, path: Path) -> None:
    """Modes found, and mass found, against evaluations; means over poses."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(13, 5))
    for index, (name, rows) in enumerate(summarised(table).items()):
        spent, modes, mass = np.array([row[1:] for row in rows if row[0] <= 1000]).T
        style = "--" if name == "draws of the prior" else "-"
        for axis, values in zip(axes, (modes, 100 * mass), strict=True):
            axis.plot(spent, values, style, marker=".", color=f"C{index}", label=name)
    axes[0].set(xscale="log", xlabel="evaluations", ylabel="share of the modes found, %")
    axes[1].set(xscale="log", xlabel="evaluations", ylabel="share of the mass found, %")
    axes[0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def summarised(table: Table) -> dict[str, list[tuple[float, ...]]]:
    """For each method, by starts: starts, evaluations, percent of the modes and share of the mass, means over poses."""
    found: dict[str, list[tuple[float, ...]]] = {}
    for name in dict.fromkeys(row[1] for row in table.rows):
        for count in dict.fromkeys(row[2] for row in table.select(method=name)):
            rows = table.select(method=name, starts=count)
            shares = [(row[3], 100 * row[4] / row[5], row[6]) for row in rows]
            found.setdefault(name, []).append((count, *np.mean(shares, 0)))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one pose and few starts, to see that it works")
    parser.add_argument("--poses", type=int, default=6)
    parser.add_argument("--starts", type=int, default=10_000, help="climbs that tell which modes there are")
    parser.add_argument("--folder", type=Path, help="where the CSV and the figure go")
    options = parser.parse_args()
    poses, starts, counts = (1, 400, (12, 24)) if options.quick else (options.poses, options.starts, (12, 24, 48, 96, 192))
    about = ABOUT.format(starts=starts)
    rows: list[tuple[Any, ...]] = []
    if options.folder:
        options.folder.mkdir(parents=True, exist_ok=True)
        known = read_folder(options.folder).get("modes_found")
        rows = list(known.table.rows) if known is not None and known.table.about == about else []
    table = Table("modes_found", COLUMNS, rows, about)
    for pose in sorted(set(range(poses)) - set(table.values("pose"))):
        rows += study(pose, starts, counts)
        if options.folder:
            command = f"python -m studies.modes_found --poses {poses} --starts {starts} --folder {options.folder}"
            today, own = datetime.now(UTC).date().isoformat(), ", ".join(f"{key} {each}" for key, each in versions().items())
            how = Provenance(f"{pose + 1} poses", "none, random poses", today, own, command)
            write_folder(options.folder, {"modes_found": Kept(table, how)})
    shown = [
        [name, f"{count:.0f}", f"{spent:.0f}", f"{modes:.0f} %", f"{100 * mass:.0f} %"]
        for name, each in summarised(table).items()
        for count, spent, modes, mass in each
    ]
    show(f"{poses} poses, one camera", ["starts drawn from", "starts", "evaluations", "modes found", "mass found"], shown)
    if options.folder:
        draw(table, options.folder / "modes_found.png")


if __name__ == "__main__":
    main()
