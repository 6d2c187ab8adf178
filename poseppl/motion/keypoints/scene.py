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
from typing import Any, Literal

import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, FilePath, InputError, Phrase
from poseppl.files.frame_range import FrameRange
from poseppl.motion.bodies.body import Body, body_builder
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.triangulation import triangulate
from poseppl.motion.io import Calibration, CameraRecord, DetectedPeople
from poseppl.motion.io.camera_fields import with_z_up
from poseppl.motion.io.cameras import calibration_of
from poseppl.motion.io.keypoint_layouts import markers_of_names
from poseppl.motion.io.length_units import UNKNOWN_UNIT
from poseppl.motion.io.text_parsing import some
from poseppl.motion.keypoints.calibration_checks import calibration_notes, vertical_of_calibration
from poseppl.motion.keypoints.calibration_units import infer_unit
from poseppl.motion.keypoints.camera_errors import MIN_RESIDUALS, CameraErrors, camera_errors
from poseppl.motion.keypoints.camera_refinement import RefinedCameras, bundle_adjust
from poseppl.motion.keypoints.data_association import associate
from poseppl.motion.keypoints.detector_errors import DetectorErrors
from poseppl.motion.keypoints.detector_files import read_detector_errors
from poseppl.motion.keypoints.keypoint_scene import MIN_AGREEMENT, KeypointScene
from poseppl.motion.keypoints.leaps import despike
from poseppl.motion.keypoints.people import associate_person
from poseppl.motion.keypoints.settings import PersonSettings
from poseppl.motion.keypoints.single_camera import noise_in_one_camera
from poseppl.motion.keypoints.sources import Clocks, align_roughly, common_frames, points_of, read_sources
from poseppl.motion.keypoints.suspected_inputs import check_inputs
from poseppl.motion.tracking.body_sizes import POPULATION, measured_lengths, subject_lengths
from poseppl.motion.tracking.default_body import DEFAULT_MODEL
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.scene import MIN_CONFIDENCE, Scene, noise_of
from poseppl.motion.tracking.walk import ASSUMED_RATE

MIN_MARKERS = 1 / 3
"""Points with names of their own are of a person if at least this share of the body's markers is among them."""
MIN_LEAP = 0.05
"""A point leaps if it is at least this share of the picture's diagonal from where it is in the frames about its own."""


def scene_of_keypoints(settings: PersonSettings) -> KeypointScene:
    """Read what a detector found, and pick one person.

    Args:
        settings: The keypoints, the calibration, and what is known of the cameras and the person.

    Raises:
        InputError: A folder has no camera, a file cannot be read, the cameras have no common frame, or there is no such person.
    """
    model, rate, frames = settings.model or DEFAULT_MODEL, settings.rate, getattr(settings, "frames", None)
    folders, clocks, noise = settings.files, _clocks(settings), noise_of_settings(settings)
    refine, mend = ("calibration" not in settings.keep), ("detections" not in settings.keep)
    given = calibration_of(settings)
    known = {record.name: record for record in given.cameras}
    people, told = read_sources(folders, known, settings.detector, settings.layout)
    markers = body_builder(model)(None).tree.marker_names
    check_markers(people[0], markers)
    check_inputs([known[name] for name in folders], people, clocks)
    records, unit_notes = _in_mm(given, [known[name] for name in folders], people, clocks)
    cameras = cameras_of_records(records)
    (people, numbers, _), clock_notes = common_frames(tuple(folders), cameras, people, clocks, frames)
    step = FrameRange.parse(frames).step
    chosen = associate_person(cameras, people, pace := clocks.rate / step, settings.person)
    bodies = [with_markers(found, markers) for found in people]
    points, confidence = points_of(bodies, chosen)
    records, up_note = _with_z_up(given, records, points, confidence, markers)
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
    size, body = _sized_body(model, settings.stature, settings.lengths, places)
    errors = _errors(body, cameras, points, places)
    spread = noise_of_points(noise, body, cameras, errors.scale, places, confidence)
    faults = {} if associated is None else {"wrong_person": 1 - associated.identity, "swaps": associated.swaps}
    data = PointData(points, spread, faults=faults)
    source = ", ".join(str(each) for each in folders.values() if not isinstance(each, DetectedPeople))
    scene = Scene(body, cameras, tuple(folders), data, numbers, rate and rate / step, source)
    wrong = calibration_notes(places, body.tree.marker_names)
    seen = (confidence, sizes, (*told, *unit_notes, up_note, *wrong, *clock_notes))
    detector_errors = noise if isinstance(noise, DetectorErrors) else None
    found = KeypointScene(
        scene, people[0].layout, errors, refined, agreement, *seen, associated, detector_errors, chosen, num_leaps, size
    )
    return found._replace(scene=scene._replace(data=data._replace(found=found.record())))


def _clocks(settings: PersonSettings) -> Clocks:
    """What settings tell of the cameras' clocks."""
    known = settings.cameras.items()
    rates = {name: camera.rate for name, camera in known if camera.rate is not None}
    offsets = {name: camera.offset for name, camera in known if camera.offset is not None}
    return Clocks(settings.rate or ASSUMED_RATE, rates, offsets, "clocks" not in settings.keep)


def noise_of_settings(settings: PersonSettings) -> DetectorErrors | float | None:
    """What settings tell of the points' noise; None if the data are to tell.

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
    """The cameras in mm, by the person's size where the calibration does not tell its unit, and what is to be told of that."""
    if given.unit is not None:
        return records, []
    if len(records) == 1:
        return records, [UNKNOWN_UNIT]
    names = [record.name for record in records]
    records, unit = infer_unit(records, align_roughly(names, people, clocks), _markers_of(people[0]))
    told = f"the calibration's unit is {unit.name}, in which the person is about {unit.stature:.2f} m tall ("
    return records, [Phrase(told, Argument("unit"), " sets another)")]


def _with_z_up(
    given: Calibration, records: list[CameraRecord], points: Floats, confidence: Floats, markers: Sequence[str]
) -> tuple[list[CameraRecord], str]:
    """The cameras in a world whose Z is up, and which axis of the calibration that is."""
    if given.up is not None:
        return records, Phrase(f"{given.up.upper()} of the calibration is up, as ", Argument("up"), " says")
    vertical = vertical_of_calibration(cameras_of_records(records), points, confidence, markers)
    return [with_z_up(record, vertical.axis) for record in records], Phrase("the calibration's ", vertical.note())


def noise_of_points(
    known: DetectorErrors | float | None, body: Body, cameras: Cameras, measured: Floats, places: Floats, confidence: Floats
) -> Floats:
    """Standard deviations (T, C, K), px: the detector's; or those known or measured, and more for less confidence."""
    sure = np.clip(confidence, MIN_CONFIDENCE, 1.0)  # what is less is not seen
    if isinstance(known, DetectorErrors):
        return known.noise(cameras, body.tree.marker_names, places, sure)
    spread = noise_of(body, cameras, known)
    if known is None:
        spread = np.where(np.isfinite(measured)[:, None], measured[:, None], spread)
    return np.asarray(spread / np.sqrt(sure))


def _refined(cameras: Cameras, points: Floats, confidence: Floats, rate: float) -> RefinedCameras | None:
    """The cameras with small errors of their poses mended; None where too few points are seen by two cameras."""
    places = triangulate(cameras, points, confidence)
    if np.isfinite(places).all(-1).sum() < MIN_RESIDUALS:
        return None
    raw = float(np.nanmin(camera_errors(cameras, points, places).scale))
    return bundle_adjust(cameras, points, confidence, raw, rate)


def _errors(body: Body, cameras: Cameras, points: Floats, places: Floats) -> CameraErrors:
    """What remains of the cameras' points, or is assumed of a single one's."""
    errors, alone = camera_errors(cameras, points, places), points.shape[1] == 1
    return errors._replace(scale=np.array([noise_in_one_camera(body, cameras, points)])) if alone else errors


def _agreement(people: Sequence[DetectedPeople], chosen: Integers) -> Floats:
    """Of the frames in which a camera sees someone, the share in which one of its detections was chosen."""
    sees = np.stack([np.isfinite(found.points).any((1, 2, 3)) for found in people], 1)
    return np.asarray((sees & (chosen >= 0)).sum(0) / np.maximum(sees.sum(0), 1))


def _markers_of(found: DetectedPeople) -> Mapping[str, int]:
    """The points' numbers by the names of a body's markers."""
    return markers_of_names(found.names)


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
