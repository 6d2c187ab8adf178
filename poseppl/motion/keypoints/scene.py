"""A scene of a detector's keypoints: one person of those that calibrated cameras found, with a noise that the data tell.

Small errors of the cameras' poses are found first (:mod:`poseppl.motion.keypoints.camera_refinement`). The noise of each camera
is what remains between its points and the projections of the places that all cameras' rays pass by; or that of a detector whose
errors are known (:mod:`poseppl.motion.keypoints.detector_errors`). A single camera does not tell its noise
(:mod:`poseppl.motion.keypoints.single_camera`). Segment lengths are measured in those places, too; one camera's person is
assumed to be of any adult's stature (:mod:`poseppl.motion.tracking.assumed_stature`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, Literal, NamedTuple

import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, FilePath, InputError, Phrase
from poseppl.files.frame_range import FrameRange
from poseppl.motion.bodies.body import Body, body_builder
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.io import Calibration, CameraRecord, DetectedPeople
from poseppl.motion.io.camera_fields import with_z_up
from poseppl.motion.io.cameras import calibration_of
from poseppl.motion.io.keypoint_layouts import markers_of_names
from poseppl.motion.io.text_parsing import some
from poseppl.motion.io.units_and_axes import UNKNOWN_UNIT
from poseppl.motion.keypoints.calibration_checks import calibration_notes, vertical_of_calibration
from poseppl.motion.keypoints.calibration_units import infer_unit
from poseppl.motion.keypoints.camera_errors import MIN_RESIDUALS, CameraErrors, camera_errors
from poseppl.motion.keypoints.camera_refinement import RefinedCameras, bundle_adjust
from poseppl.motion.keypoints.data_association import associate
from poseppl.motion.keypoints.detector_errors import DetectorErrors
from poseppl.motion.keypoints.detector_files import read_detector_errors
from poseppl.motion.keypoints.keypoint_scene import MIN_AGREEMENT, KeypointScene
from poseppl.motion.keypoints.leaps import despike
from poseppl.motion.keypoints.people import associate_people, associate_person, num_people
from poseppl.motion.keypoints.point_errors import PointErrors, point_errors
from poseppl.motion.keypoints.settings import PersonSettings
from poseppl.motion.keypoints.single_camera import noise_in_one_camera
from poseppl.motion.keypoints.sources import Clocks, align_roughly, common_frames, points_of, read_sources
from poseppl.motion.keypoints.suspected_inputs import check_inputs
from poseppl.motion.tracking.body_sizes import POPULATION, measured_lengths, subject_lengths
from poseppl.motion.tracking.default_body import model_of_points
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.scene import MIN_CONFIDENCE, Scene, noise_of
from poseppl.motion.tracking.walk import ASSUMED_RATE

MIN_MARKERS = 1 / 3
"""Points with names of their own are of a person if at least this share of the body's markers is among them."""
MIN_FOUND = 0.05
"""Share of the frames in which a camera finds a point, at least, for the body to have it; ours."""
MIN_LEAP = 0.05
"""A point leaps if it is at least this share of the picture's diagonal from where it is in the frames about its own."""


def scene_of_keypoints(settings: PersonSettings) -> KeypointScene:
    """Read what a detector found, and pick one person.

    Args:
        settings: The keypoints, the calibration, and what is known of the cameras and the person.

    Raises:
        InputError: A folder has no camera, a file cannot be read, the cameras have no common frame, or there is no such person.
    """
    noise = noise_of_settings(settings)
    refine, mend = ("calibration" not in settings.keep), ("detections" not in settings.keep)
    read = _read(settings)
    people, records, pace, cameras = read.people, read.records, read.pace, cameras_of_records(read.records)
    chosen = associate_person(cameras, people, pace, settings.person)
    markers = body_builder(read.model)(None).tree.marker_names
    bodies = [with_markers(found, markers) for found in people]
    points, confidence = points_of(bodies, chosen)
    records, up_note = _with_z_up(read.given, records, points, confidence, markers)
    cameras = cameras_of_records(records)
    sizes = np.array([record.size for record in records], float)
    far = MIN_LEAP * np.linalg.norm(sizes, axis=-1) if mend else np.inf
    refined = _refined(cameras, despike(points, far), confidence, pace) if refine else None
    cameras = cameras if refined is None else refined.cameras
    agreement = _agreement(people, chosen)
    told_apart = mend and bool((agreement >= MIN_AGREEMENT).all())
    associated = associate(cameras, sizes, bodies, chosen, pace) if told_apart else None
    points, confidence = (points, confidence) if associated is None else (associated.points, associated.confidence)
    leaping, points = points, despike(points, far)
    num_leaps = int((np.isfinite(leaping) & ~np.isfinite(points)).any(-1).sum())
    places = triangulate(cameras, points, confidence)
    size, body = _sized_body(read.model, settings.stature, settings.lengths, places)
    errors, own = _errors(body, cameras, points, places), point_errors(cameras, points, confidence, pace)
    known_noise = own if noise is None else noise
    spread = noise_of_points(known_noise, body, cameras, errors.scale, places, confidence)
    faults = {} if associated is None else {"wrong_person": 1 - associated.identity, "swaps": associated.swaps}
    data = PointData(points, spread, faults=faults)
    source = ", ".join(str(each) for each in settings.files.values() if not isinstance(each, DetectedPeople))
    scene = Scene(body, cameras, tuple(settings.files), data, read.numbers, settings.rate and pace, source)
    wrong = calibration_notes(places, body.tree.marker_names)
    seen = (confidence, sizes, (*read.notes, up_note, *wrong, *read.clock_notes))
    detector_errors = noise if isinstance(noise, DetectorErrors) else None
    found = KeypointScene(
        *(scene, people[0].layout, errors, refined, agreement, *seen, associated, detector_errors, chosen, num_leaps, size),
        *(own, read.model),
    )
    return found._replace(scene=scene._replace(data=data._replace(found=found.record())))


class _Read(NamedTuple):
    """Detections of all people by all cameras, in common frames.

    Attributes:
        given: The calibration.
        records: The cameras, mm.
        people: Detections of each camera.
        numbers: (T,) of the frames.
        pace: Frames a second of these, those of the assumed rate where none is known.
        model: Builder of the body.
        notes: On the files and the unit.
        clock_notes: On the clocks.
    """

    given: Calibration
    records: list[CameraRecord]
    people: list[DetectedPeople]
    numbers: Integers
    pace: float
    model: str
    notes: list[str]
    clock_notes: list[str]


def _read(settings: PersonSettings) -> _Read:
    """Read the files of all cameras, and bring them to common frames."""
    folders, clocks, frames = settings.files, _clocks(settings), getattr(settings, "frames", None)
    given = calibration_of(settings)
    known = {record.name: record for record in given.cameras}
    people, reading_notes = read_sources(folders, known, settings.detector, settings.layout)
    model = settings.model or model_of_points(_found_markers(people))
    check_markers(people[0], body_builder(model)(None).tree.marker_names)
    check_inputs([known[name] for name in folders], people, clocks)
    records, unit_notes = _in_mm(given, [known[name] for name in folders], people, clocks)
    (people, numbers, _), clock_notes = common_frames(tuple(folders), cameras_of_records(records), people, clocks, frames)
    pace = clocks.rate / FrameRange.parse(frames).step
    return _Read(given, records, people, numbers, pace, model, [*reading_notes, *unit_notes], clock_notes)


def people_of_keypoints(settings: PersonSettings, most: int) -> int:
    """How many people, at most ``most``, two cameras or more see in a fair share of the frames.

    Args:
        settings: As for :func:`scene_of_keypoints`; its person is not read.
        most: Largest number; the search ends there.

    Raises:
        InputError: As :func:`scene_of_keypoints`.
    """
    read = _read(settings)
    return num_people(associate_people(cameras_of_records(read.records), read.people, read.pace), most)


def _clocks(settings: PersonSettings) -> Clocks:
    """Known clocks of the cameras, from the settings."""
    known = settings.cameras.items()
    rates = {name: camera.rate for name, camera in known if camera.rate is not None}
    offsets = {name: camera.offset for name, camera in known if camera.offset is not None}
    return Clocks(settings.rate or ASSUMED_RATE, rates, offsets, "clocks" not in settings.keep)


def noise_of_settings(settings: PersonSettings) -> DetectorErrors | float | None:
    """Noise of the points from the settings; None if it is to be estimated.

    Raises:
        InputError: The file of a detector's errors cannot be used.
    """
    given: Any = settings.noise
    return read_detector_errors(given) if isinstance(given, str | PathLike) else given


def _sized_body(
    model: str, stature: float | None, lengths: FilePath | None, places: Floats
) -> tuple[Literal["given", "measured", "assumed"], Body]:
    """How the person's size is known, of whom there are places (T, K, 3), and the body of that size."""
    build = body_builder(model)
    if stature is not None or lengths is not None:
        return "given", build(subject_lengths(model, stature, lengths))
    if np.isfinite(places).all(-1).any():
        return "measured", build(measured_lengths(build(None), places))
    return "assumed", build(subject_lengths(model, POPULATION[0], lengths))


def _in_mm(
    given: Calibration, records: list[CameraRecord], people: Sequence[DetectedPeople], clocks: Clocks
) -> tuple[list[CameraRecord], list[str]]:
    """The cameras in mm, by the person's size where the calibration has no unit, and notes about this."""
    if given.unit is not None:
        return records, []
    if len(records) == 1:
        return records, [UNKNOWN_UNIT]
    names = [record.name for record in records]
    records, unit = infer_unit(records, align_roughly(names, people, clocks), _markers_of(people[0]))
    text = f"the calibration's unit is {unit.name}, in which the person is about {unit.stature:.2f} m tall ("
    return records, [Phrase(text, Argument("unit"), " sets another)")]


def _with_z_up(
    given: Calibration, records: list[CameraRecord], points: Floats, confidence: Floats, markers: Sequence[str]
) -> tuple[list[CameraRecord], str]:
    """The cameras in a world whose Z is up, and which axis of the calibration that is."""
    if given.up is not None:
        return records, Phrase(f"{given.up.upper()} of the calibration is up, as ", Argument("up"), " says")
    vertical = vertical_of_calibration(cameras_of_records(records), points, confidence, markers)
    return [with_z_up(record, vertical.axis) for record in records], Phrase("the calibration's ", vertical.note())


def noise_of_points(
    known: DetectorErrors | PointErrors | float | None,
    body: Body,
    cameras: Cameras,
    measured: Floats,
    places: Floats,
    confidence: Floats,
) -> Floats:
    """Standard deviations (T, C, K), px: the detector's or the recording's; or those known, more for less confidence."""
    sure = np.clip(confidence, MIN_CONFIDENCE, 1.0)  # what is less is not seen
    if isinstance(known, DetectorErrors | PointErrors):
        return known.noise(cameras, body.tree.marker_names, places, sure)
    spread = noise_of(body, cameras, known)
    if known is None:
        spread = np.where(np.isfinite(measured)[:, None], measured[:, None], spread)
    return np.asarray(spread / np.sqrt(sure))


def _refined(cameras: Cameras, points: Floats, confidence: Floats, rate: float) -> RefinedCameras | None:
    """The cameras with small errors of their poses corrected; None where too few points are seen by two cameras."""
    places = triangulate(cameras, points, confidence)
    if np.isfinite(places).all(-1).sum() < MIN_RESIDUALS:
        return None
    raw = float(np.nanmin(camera_errors(cameras, points, places).scale))
    return bundle_adjust(cameras, points, confidence, raw, rate)


def _errors(body: Body, cameras: Cameras, points: Floats, places: Floats) -> CameraErrors:
    """Noise and bias of the cameras' points, assumed for a single camera."""
    errors, alone = camera_errors(cameras, points, places), points.shape[1] == 1
    return errors._replace(scale=np.array([noise_in_one_camera(body, cameras, points)])) if alone else errors


def _agreement(people: Sequence[DetectedPeople], chosen: Integers) -> Floats:
    """Share of the frames with detections in a camera in which one of them was chosen."""
    sees = np.stack([np.isfinite(found.points).any((1, 2, 3)) for found in people], 1)
    return np.asarray((sees & (chosen >= 0)).sum(0) / np.maximum(sees.sum(0), 1))


def _markers_of(found: DetectedPeople) -> Mapping[str, int]:
    """The points' numbers by the names of a body's markers."""
    return markers_of_names(found.names)


def _found_markers(people: Sequence[DetectedPeople]) -> set[str]:
    """Names of the markers that some camera found in :data:`MIN_FOUND` of the frames, with a confidence that counts."""
    found = [(each.confidence >= MIN_CONFIDENCE) & np.isfinite(each.points).all(-1) for each in people]
    any_of = np.any([seen.any(1).mean(0) >= MIN_FOUND for seen in found], 0)
    return {name for name, number in _markers_of(people[0]).items() if any_of[number]}


def check_markers(found: DetectedPeople, markers: Sequence[str]) -> None:
    """Check that points that have names of their own are those of a person, of whom they are enough of the body's markers.

    Raises:
        InputError: They are of an animal, an object or another body.
    """
    known = set(markers) & set(_markers_of(found))
    if len(known) < (1 if found.layout else MIN_MARKERS * len(markers)):
        named = found.layout or f"points called {some(found.names)}"
        raise InputError(
            f"{len(known)} of the body's {len(markers)} markers are among {named}",
            field=Argument("files"),
            expected=Phrase(
                "points of a person. Animals and objects are tracked as points (docs/points.md), another body with ",
                Argument("model", "BUILDER"),
            ),
        )


def with_markers(found: DetectedPeople, markers: Sequence[str]) -> DetectedPeople:
    """The same of a body's markers; those without a keypoint are never seen, nor are points of too little confidence."""
    check_markers(found, markers)
    table = _markers_of(found)
    known = [name for name in markers if name in table]
    into, of = [markers.index(name) for name in known], [table[name] for name in known]
    points = np.full((*found.points.shape[:2], len(markers), 2), np.nan)
    confidence = np.zeros(points.shape[:3])
    points[:, :, into], confidence[:, :, into] = found.points[:, :, of], found.confidence[:, :, of]
    points = np.where((confidence >= MIN_CONFIDENCE)[..., None], points, np.nan)
    return found._replace(points=points, confidence=confidence, names=tuple(markers))
