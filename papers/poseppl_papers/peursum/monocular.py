"""Section 7.2, Table 3: filters and smoothers before the published body, animated by a recorded walk, seen by one camera.

The person walks straight on, at an angle away from the camera, so that much of the motion is along its axis. The body fits
what is seen exactly. Its pictures are taken apart as those of any video: silhouettes by subtraction of an empty plate, edges by
gradients.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.images.image_systems import SeenPerson, Sight, build_system
from poseppl_models.images.silhouette_bits import body_bits, unpack_bits

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.motion.bodies.body import load_builder
from poseppl.motion.bodies.subject import fit_subject
from poseppl.motion.geometry import Cameras, marker_positions
from poseppl.motion.geometry.flesh import parts_of
from poseppl.motion.io import slice_frames
from poseppl.motion.io.opencv import Image, opencv
from poseppl.motion.tracking.marker_errors import VIRTUAL_MARKERS, virtual_markers
from poseppl.motion.tracking.placing import cameras_of_records, place_cameras, records_of_cameras
from poseppl.motion.vision import FeatureSettings, background_from_plate, extract
from poseppl_papers.experiment import Claim, Jobs, Results, Tables
from poseppl_papers.images.systems import Problem, System
from poseppl_papers.measured import MATTERS, Interval, mean_interval
from poseppl_papers.peursum.scenes import BODY, motion_at
from poseppl_papers.peursum.smoothed_walks import ALGORITHMS, SmoothedRuns, motion_of, smooth_track
from poseppl_papers.peursum.tracks import posture_squares, run_track
from poseppl_papers.recordings import Recording
from poseppl_papers.runs import stacked
from poseppl_papers.tables import Table, grouped, markdown

BURN_IN_FRAMES = 5
BOUND = 100 * MATTERS
COLUMNS = ("scene", "frames", "filter", "smoother", "run", "relative", "absolute", "ess_share")
FILTER, SMOOTHERS = ALGORITHMS[0], ALGORITHMS[1:]
SHARPER = "lambda"
"""In the names of filters whose likelihood is sharpened as one camera in place of four would have it."""
GENERIC = "Simple-PF"
"""First word of the filter's name whose motion is not learned."""
THEIRS = {GENERIC: (111.1, 112.1, 120.1, 111.7), "FSHHMM-PF": (54.1, 47.6, 57.3, 57.1)}
"""Table 3: relative errors by :data:`ALGORITHMS`, mm."""
_ABOUT = (
    "Root mean squared error of the mean posture over fifteen markers and the frames from the sixth on (mm), with the pelvises "
    "together and as it is; mean share of particles that are effective."
)


@dataclass(frozen=True)
class SmoothedAnimation(SmoothedRuns):
    """Runs before the animated body."""

    scene: AnimatedScene


def smooth_animation(job: SmoothedAnimation) -> dict[str, Any]:
    """Run the filter and the smoothers.

    Returns:
        ``squares`` (run, algorithm, frame, 2), mm^2, by :data:`ALGORITHMS`: mean squared distances of markers from the truth,
        as they are and with the pelvises together; ``ess_share`` (run,).
    """
    system = job.taught
    problem = animated_problem(job.scene, system)
    filter = job.method.build(problem)
    step, motion, rows = jit(filter.step), motion_of(problem, system), []
    for run in job.runs:
        found = smooth_track(problem, run_track(problem, filter, step, run), motion, job.rounds, run, posture_squares)
        rows.append({"squares": found["errors"], "ess_share": np.asarray(found["ess_share"])})
    return stacked(rows)


def monocular_table(jobs: Jobs, results: Results) -> list[Table]:
    """One row a filter, smoother and run."""
    rows: list[tuple[Any, ...]] = []
    for job in jobs["monocular"]:
        found = results[job.key]
        for index, run in enumerate(job.runs):
            for number, name in enumerate(ALGORITHMS):
                absolute, relative = np.sqrt(found["squares"][index, number, BURN_IN_FRAMES:].mean(0)).tolist()
                figures = relative, absolute, float(found["ess_share"][index])
                rows.append((job.scene.name, job.scene.num_frames, job.method.name, name, run, *figures))
    return [Table("monocular", COLUMNS, rows, _ABOUT)]


def errors(table: Table, filter: str, smoother: str, column: str = "relative") -> dict[str, float]:
    """A column of a filter and smoother by person, the mean over runs."""
    groups = grouped(table.records(filter=filter, smoother=smoother), lambda row: row["scene"])
    return {scene: float(np.mean([row[column] for row in rows])) for scene, rows in groups.items()}


def monocular(tables: Tables) -> str:
    """Errors of all algorithms beside the published ones, and what smoothers take away of them."""
    if "monocular" not in tables:
        return ""
    table, rows = tables["monocular"], []
    for filter in table.values("filter"):
        theirs = _published(filter)
        for name, published in zip(ALGORITHMS, theirs, strict=True):
            own, whole, ess = (errors(table, filter, name, column) for column in ("relative", "absolute", "ess_share"))
            less = "" if name == FILTER else _gain(table, filter, name).text()
            share, runs = f"{np.mean(list(ess.values())):.2g}", len(table.select(filter=filter, smoother=name))
            rows.append([filter, name, f"{published:g}", _told(own), less, _told(whole), share, str(len(own)), str(runs)])
    columns = ("filter", "smoother", "published, relative", "relative", "less, %", "absolute", "ESS / N", "walks", "runs")
    return markdown(columns, rows)


def monocular_claims(tables: Tables) -> list[Claim]:
    """Claims of section 7.2 about the two filters and each smoother."""
    table, found = tables["monocular"], []
    for filter in table.values("filter"):
        before, *smoothed = _published(filter)
        less = {name: 100 * (1 - value / before) for name, value in zip(SMOOTHERS, smoothed, strict=True)}
        gains = {name: _gain(table, filter, name) for name in SMOOTHERS}
        verdicts = "; ".join(f"{name} {gain.agrees(less[name], BOUND)}" for name, gain in gains.items())
        theirs, ours = (", ".join(f"{name} {value}" for name, value in each) for each in (_shown(less), _intervals(gains)))
        what = f"Table 3: what smoothers take away from the relative error of {filter}, one camera"
        walks = len(errors(table, filter, FILTER))
        ours = f"% less: {ours}; {walks} walk{'s' if walks > 1 else ''}"
        found.append(Claim(what, f"% less: {theirs}", ours, verdicts, _WHY))
    generic = [filter for filter in table.values("filter") if filter.startswith(GENERIC)]
    learned = [filter for filter in table.values("filter") if not filter.startswith(GENERIC)]
    pairs = [(own, other) for other in generic for own in learned if (SHARPER in own) == (SHARPER in other)]
    return found + [_halved(table, own, other) for own, other in pairs]


def _halved(table: Table, filter: str, generic: str) -> Claim:
    own, other = (errors(table, name, FILTER) for name in (filter, generic))
    shares = [100 * own[scene] / other[scene] for scene in other if scene in own]
    share, theirs = mean_interval(shares), [_published(name)[0] for name in (filter, generic)]
    limit = 100 * theirs[0] / theirs[1] + BOUND
    what = f"Table 3: from one camera the relative error of {filter} is half of that of {generic}"
    ours = f"{_told(own)} mm against {_told(other)}; {share.text()} %, {len(shares)} walk{'s' if len(shares) != 1 else ''}"
    published = "" if generic.startswith(f"{GENERIC}, 10,000") else "; the paper's Simple-PF has 10,000 particles"
    why = (
        f"at most {limit:.0f} %, which is theirs and the {BOUND:.0f} % that do not matter; 95 % interval over people{published}"
    )
    return Claim(what, "54.1 mm against 111.1, 49 %", ours, share.below(limit), why)


_WHY = f"more or less by at least {BOUND:.0f} %, or alike, as in the paper; 95 % interval over people"


def _gain(table: Table, filter: str, smoother: str) -> Interval:
    """How much lower the smoother's relative error is, % of its filter's, over people."""
    before, own = (errors(table, filter, name) for name in (FILTER, smoother))
    return mean_interval([100 * (1 - own[scene] / before[scene]) for scene in own])


def _shown(values: Mapping[str, float]) -> list[tuple[str, str]]:
    return [(name, f"{value:.0f}") for name, value in values.items()]


def _intervals(values: Mapping[str, Interval]) -> list[tuple[str, str]]:
    return [(name, value.text()) for name, value in values.items()]


def _published(filter: str) -> tuple[float, ...]:
    return next(errors for word, errors in THEIRS.items() if filter.startswith(word))


def _told(values: Mapping[str, float]) -> str:
    return mean_interval(list(values.values())).text()


PERSON = "poseppl_models.images.image_systems:peursum_person"
VIEW = 150.0
"""Degrees from the front of the person: 30 from straight away."""
DISTANCE, FOCAL = 4000.0, 800.0
"""From the camera to the nearest place of the walk, mm; px."""
GROUND = 110
"""Gray level of the plate; parts are lighter and have hues of their own."""
_SETTINGS = FeatureSettings(flow=None)


@dataclass(frozen=True)
class AnimatedScene:
    """A walk of the published body.

    Attributes:
        recording: Whose walk.
        num_frames: How many frames, from the first on.
        rate: Frames a second.
        width: Width of the images, px.
        height: Height of the images, px.
    """

    recording: Recording
    num_frames: int
    rate: float = 25.0
    width: int = 640
    height: int = 480

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.recording.name}-animated"


def animated_problem(scene: AnimatedScene, system: System) -> Problem:
    """Put a system before the animated body.

    Raises:
        InputError: The recording cannot be read or is too short, or there is no such builder.
    """
    person, truth, images = _filmed(scene)
    sights = list(_sights(images))
    built = build_system(system.builder, person._replace(first=sights[0]), {"views": 1, **dict(system.settings)})
    frames = [built.inputs(sight) for sight in sights]
    return Problem(built, built.program.compile(frames[0], built.params), frames, truth)


@lru_cache(maxsize=2)
def _filmed(scene: AnimatedScene) -> tuple[SeenPerson, Floats, list[Image]]:
    """Person that is seen, without a first frame; the fifteen virtual markers (T, 15, 3), mm; and the pictures."""
    body, states = _animated(scene)
    places = jax.vmap(partial(marker_positions, body.tree))(jnp.asarray(states, float))
    truth = np.asarray(virtual_markers(body.tree.marker_names, places), np.float64)
    size = scene.width, scene.height
    placed = place_cameras(truth[:, 0], 0.0, distance=DISTANCE, view=VIEW)
    cameras = cameras_of_records(records_of_cameras(placed, FOCAL * scene.width / 640, size))
    markers = dict(zip(VIRTUAL_MARKERS, np.moveaxis(truth, 1, 0), strict=True))
    person = SeenPerson(markers, scene.rate, cameras, Sight((), ()))
    return person, truth, draw_body(body, states, cameras, size)


def _animated(scene: AnimatedScene) -> tuple[Any, Floats]:
    """The published body in the person's size, and its poses (T, d)."""
    motion = motion_at(scene.recording, scene.rate)
    walk = fit_subject(slice_frames(motion, f"0:{min(scene.num_frames, len(motion.positions))}"), load_builder(BODY))
    own = np.asarray(virtual_markers(walk.body.tree.marker_names, walk.body.places(walk.states)), np.float64)
    fitting: Any = load_builder(PERSON)
    body, states = fitting(dict(zip(VIRTUAL_MARKERS, np.moveaxis(own, 1, 0), strict=True)))
    return body, np.asarray(states, np.float64)


def draw_body(body: Any, states: Floats, cameras: Cameras, size: tuple[int, int]) -> list[Image]:
    """Pictures (H, W, 3), RGB, of a body of cones in poses (T, d) before a gray ground, near parts over far ones.

    Args:
        body: With a tree and flesh, as :class:`poseppl_models.bodies.cone_body.ConeBody`.
        states: Poses.
        cameras: One camera, px.
        size: Width and height, px.
    """
    width, height = size
    tree, flesh, eyes = jax.tree.map(lambda leaf: jnp.asarray(leaf)[..., None], (body.tree, body.flesh, cameras))
    parts = parts_of(tree, flesh, jnp.asarray(states.T, float))
    middles = np.asarray((parts.base + parts.tip) / 2)  # (P, 3, T)
    far = np.linalg.norm(middles - np.asarray(cameras.centre)[0][None, :, None], axis=1)
    words, hues = -(-width // 32), _hues(len(far))
    images = np.full((len(states), height, width, 3), GROUND, np.uint8)
    masks = []
    for number in range(len(far)):
        one = slice(number, number + 1)
        own, place = jax.tree.map(lambda leaf, one=one: leaf[one], (flesh, parts))
        bits = body_bits(eyes, own, place, height, words, 1)
        masks.append(np.stack([unpack_bits(row, width)[0] for row in np.moveaxis(np.asarray(bits), -1, 0)]))
    for frame, order in enumerate(np.argsort(-far, axis=0).T):
        for number in order:
            images[frame][masks[number][frame]] = hues[number]
    return list(images)


def _hues(count: int) -> Image:
    """Light colours (count, 3), RGB, no two alike."""
    cv2 = opencv()
    turns = (np.arange(count) * 0.618) % 1 * 179
    tones = np.stack([turns, np.full(count, 150), np.where(np.arange(count) % 2, 255, 205)], -1)
    colours: Image = cv2.cvtColor(tones[None].astype(np.uint8), cv2.COLOR_HSV2RGB)[0]
    return colours


def _sights(images: list[Image]) -> Iterator[Sight]:
    """Features of the pictures."""
    background = background_from_plate(np.full_like(images[0], GROUND), _SETTINGS.background)
    for number, image in enumerate(images):
        yield Sight((extract(image, background, _SETTINGS, frame=number),), (image,))
