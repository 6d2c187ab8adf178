"""What three papers ran on video: their body, likelihood, dynamics and filters, on a scene whose truth is known.

Bodies have the scene's stature; those of Darby and of Du and Guan its segment lengths, too (Peursum's has fixed proportions).
The first state is Gaussian around the body's pose that is closest to the first frame's truth, with the walk's own scale.
Peursum's diffusion is the published one (section 5.2), of variances a frame at 25 Hz. For the others it is half the largest
change of each coordinate between frames (Darby, section 6.2; Du and Guan do not tell), here of the fitted truth of the scene,
which tells the filters how fast this person walks, and not when or where to; "peursum-measured" has Peursum's filters with it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from image_scene import STRIDE, Seen, frames_of
from poseppl_models.anthropometry import STATURE
from poseppl_models.body_constraints import hard_constraints
from poseppl_models.body_fit import fitted_states, fitted_stature, measured_lengths
from poseppl_models.cone_body import ConeBody, with_crown
from poseppl_models.darby_body import darby_body
from poseppl_models.darby_likelihood import darby_monocular_score, darby_score
from poseppl_models.du_guan_body import du_guan_body
from poseppl_models.du_guan_likelihood import du_guan_score
from poseppl_models.feature_evidence import colours_at, du_guan_of_features
from poseppl_models.image_program import ImageInputs, image_program
from poseppl_models.peursum_body import peursum_body
from poseppl_models.peursum_likelihood import peursum_score

from poseppl.filters import Filter, annealed_filter, demc_filter, particle_filter
from poseppl.program import CompiledModel

VARIANCES = {"tx": 300.0, "ty": 300.0, "tz": 100.0, "Z": 6.0, "X": 8.0, "Y": 4.0}
"""Peursum's, mm^2 and square degrees: azimuth, elevation and roll are taken for turns about z, x and y."""
HEADING = 20.0
_LEAST_ANGLE, _LEAST_PLACE = 0.01, 2.0
_LIMBS = (("clavicle", "shoulder", "elbow"), ("hip", "knee"))

Filters = Mapping[str, Callable[[CompiledModel], Filter]]


class Problem(NamedTuple):
    """One system on one scene.

    Attributes:
        system: Its name.
        views: How many cameras.
        seen: The scene.
        body: The body.
        model: The compiled model.
        frames: Inputs of each frame.
        fitted: Poses closest to the truth (T, d).
        filters: What is compared, and how it is built.
    """

    system: str
    views: int
    seen: Seen
    body: ConeBody
    model: CompiledModel
    frames: list[ImageInputs]
    fitted: np.ndarray
    filters: Filters


def peursum(seen: Seen, views: int, share: float, *, measured: bool = False, exponent: float = 10.0) -> list[Problem]:
    """With the published diffusion, or that of the other two systems; the exponent is lambda of Eq. 9."""
    lengths = measured_lengths(seen.places)
    body = with_crown(peursum_body(fitted_stature(lengths) / STATURE), lengths["head"])
    fitted, root = fitted_states(body, seen.places), body.tree.joint_names[0]
    variances = [HEADING if pair == (root, "Z") else VARIANCES[pair[1]] for pair in body.tree.coordinates]
    turns = np.array([len(axis) == 1 for _, axis in body.tree.coordinates])
    scale = np.sqrt(np.array(variances) * 25.0 / seen.rate) * np.where(turns, np.pi / 180, 1.0)
    name = "peursum-measured" if measured else "peursum"
    if measured:
        scale = _half_of_largest(body, fitted)
    frames = frames_of(seen, range(views), _cameras(seen.two_way, views), fitted[0], scale, scale)
    program = image_program(body, peursum_score(STRIDE), {"limits": hard_constraints()["limits"]})
    many, few = (max(20, round(share * count)) for count in (10_000, 1_000))
    filters: Filters = {
        f"Simple-PF, {many:,}": lambda model: particle_filter(model, many),
        f"Simple-PF, {few:,}": lambda model: particle_filter(model, few),
        f"Simple-APF, 10 x {few:,}": lambda model: annealed_filter(model, few, num_layers=10),
    }
    return [Problem(name, views, seen, body, program.compile(frames[0], {"lambda": exponent}), frames, fitted, filters)]


def darby(seen: Seen, views: int, share: float) -> list[Problem]:
    body, fitted, scale = _measured(darby_body, seen)
    groups = [
        [i for i, (joint, _) in enumerate(body.tree.coordinates) if joint[:-2] in limb and joint.endswith(f"_{side}")]
        for limb in _LIMBS
        for side in "lr"
    ]
    counts = sorted({max(10, round(share * count)) for count in (40, 100, 200, 500, 1000)})
    filters: Filters = {
        f"APF, 5 x {count:,}": lambda model, count=count: annealed_filter(model, count, num_layers=5, crossover=groups)
        for count in counts
    }
    problems = []
    for name, score, number in (("Eq. 8", darby_score(), views), ("Eq. 9", darby_monocular_score(STRIDE), 1)):
        frames = frames_of(seen, range(number), _cameras(seen.two_way, number), fitted[0], scale, scale)
        model = image_program(body, score, hard_constraints()).compile(frames[0], {"beta": 10.0, "gamma": 5.0})
        problems.append(Problem(f"darby, {name}", number, seen, body, model, frames, fitted, filters))
    return problems


def du_guan(seen: Seen, views: int, share: float) -> list[Problem]:
    """Of 3,500 evaluations T layers have N (T + 1): the first population is evaluated, too."""
    body, fitted, scale = _measured(du_guan_body, seen)
    camera = jax.tree.map(lambda leaf: leaf[:1], seen.cameras)
    colours = colours_at(body, fitted[0], camera, seen.features[:1], seen.images[:1])
    rows = [
        jax.tree.map(np.asarray, du_guan_of_features([features], [image], colours, stride=STRIDE))
        for features, image in zip(seen.features, seen.images, strict=True)
    ]
    frames = frames_of(seen, [0], jax.tree.map(lambda *leaves: np.stack(leaves), *rows), fitted[0], scale, scale)
    program = image_program(body, du_guan_score(STRIDE), {"limits": hard_constraints()["limits"]})
    whole, layer = (max(20, round(share * count)) for count in (5_000, 500))
    filters: dict[str, Callable[[CompiledModel], Filter]] = {
        f"CONDENSATION, {whole:,}": lambda model: particle_filter(model, whole),
        f"APF, 10 x {layer:,}": lambda model: annealed_filter(model, layer, num_layers=10),
    }
    for prediction in ("velocity", "transition"):
        for layers in (2, 5, 7):
            count = max(10, round(share * 3500)) // (layers + 1)
            filters[f"DE-MC ({prediction}), {layers} layers of {count:,}"] = (
                lambda model, count=count, layers=layers, prediction=prediction: demc_filter(
                    model, count, num_layers=layers, prediction=prediction
                )
            )
    params = {"colour_scale": 0.3, "boundary_scale": 0.3}
    return [Problem("du-guan", 1, seen, body, program.compile(frames[0], params), frames, fitted, filters)]


SYSTEMS: Mapping[str, Callable[[Seen, int, float], list[Problem]]] = {
    "peursum": peursum,
    "peursum-measured": partial(peursum, measured=True),
    "darby": darby,
    "du-guan": du_guan,
}


def _cameras(evidence: Any, views: int) -> Any:
    return jax.tree.map(lambda leaf: leaf[:, :views], evidence)


def _measured(build: Callable[..., ConeBody], seen: Seen) -> tuple[ConeBody, np.ndarray, np.ndarray]:
    """A body of the person's lengths, the poses closest to the truth, and half their largest changes between frames."""
    lengths = measured_lengths(seen.places)
    segments = {name: length for name, length in lengths.items() if name != "head"}
    body = with_crown(build(fitted_stature(lengths), segments), lengths["head"])
    fitted = fitted_states(body, seen.places)
    return body, fitted, _half_of_largest(body, fitted)


def _half_of_largest(body: ConeBody, fitted: np.ndarray) -> np.ndarray:
    least = np.where([len(axis) == 2 for _, axis in body.tree.coordinates], _LEAST_PLACE, _LEAST_ANGLE)
    return np.maximum(np.abs(np.diff(fitted, axis=0)).max(0) / 2, least)
