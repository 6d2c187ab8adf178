"""A person tracked while a detector is at work: the first frames determine the settings of the filter for the others.

The first frames determine the layout, the unit, the cameras' small errors, the tracked person, the segment lengths, the noise,
and the first pose. The function :func:`~poseppl.motion.keypoints.scene.scene_of_keypoints` finds them, as in a whole recording.
The frames that follow are filtered one by one. The person in them is the one nearest to the position in the previous frame. The
cameras share a clock, and left and right are taken as the detector has them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import numpy as np
import xarray as xr

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError, Location
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.io import DetectedPeople
from poseppl.motion.io.detections import without_strays
from poseppl.motion.io.growing_folders import KeypointFrame
from poseppl.motion.io.json_people import same_points
from poseppl.motion.io.keypoint_layouts import with_layout
from poseppl.motion.keypoints.detector_errors import DetectorErrors
from poseppl.motion.keypoints.people import FollowedPerson
from poseppl.motion.keypoints.point_errors import PointErrors
from poseppl.motion.keypoints.scene import noise_of_points, noise_of_settings, scene_of_keypoints, with_markers
from poseppl.motion.keypoints.settings import PersonSettings
from poseppl.motion.keypoints.sources import points_of
from poseppl.motion.settings import TrackSettings
from poseppl.motion.tracking.assumed_stature import ATTRIBUTE, along_rays, stature_draws
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.problem import with_frames
from poseppl.motion.tracking.track import Tracking, prepare
from poseppl.motion.tracking.walk import ASSUMED_RATE
from poseppl.runs.labels import QUANTILES
from poseppl.runs.online_run import OnlineRun
from poseppl.runs.step_output import StepOutput

MAX_DRAWS = 20
"""Draws kept of each chain, or of all particles, by default: how many frames will come is not known."""
_ENDS = [QUANTILES.index(0.05), QUANTILES.index(0.95)]


class LiveEstimate(NamedTuple):
    """Positions of the joints in T frames.

    Attributes:
        frames: T numbers.
        mean: (T, K, 3) mm, in the calibration's world.
        lower: (T, K, 3), the lower ends of 90 % intervals.
        upper: (T, K, 3), their upper ends.
    """

    frames: list[int]
    mean: Floats
    lower: Floats
    upper: Floats


def sees_someone(frame: KeypointFrame) -> bool:
    """Whether two cameras, or the only one, found somebody."""
    return sum(bool(people) for people in frame.people) >= min(2, len(frame.people))


class LiveTrack:
    """A person who is tracked live.

    Args:
        source: The cameras' folders, and whom they see.
        first: The first frames.
        settings: How to track; without a learned walk or a learned prior.
        note: Is called with each sentence that the user should know.

    Attributes:
        estimate: Positions of the joints in the first frames.
        markers: Names of the joints.

    Raises:
        InputError: The first frames cannot be used, or a setting is out of range.
        RunError: The run cannot go on.
    """

    def __init__(
        self,
        source: PersonSettings,
        first: Sequence[KeypointFrame],
        settings: TrackSettings,
        note: Callable[[str], None],
    ) -> None:
        self._note, self._rate = note, source.rate or ASSUMED_RATE
        people = _first_people(source.files, first, source.layout)
        noise = noise_of_settings(source)
        self._noise = noise if isinstance(noise, int | float) else None
        keep = (*source.keep, "clocks", "detections")
        self._found = found = scene_of_keypoints(replace(source, files=people, layout=None, noise=noise, keep=keep))
        for text in found.notes():
            note(text)
        self._strays = {name for name in people if any(text.startswith(f"{name}: ") for text in found.reading_notes)}
        scene = found.scene._replace(source=", ".join(map(str, source.files.values())))
        self._tracking = prepare(scene, replace(settings, max_draws=settings.max_draws or MAX_DRAWS))
        self.markers = scene.body.tree.marker_names
        self._layout, self._names = found.layout, next(iter(people.values())).names
        placed = [with_markers(each, self.markers) for each in people.values()]
        self._person = FollowedPerson(scene.cameras, placed, np.asarray(found.chosen), self._rate)
        self._places = _last_known(triangulate(scene.cameras, scene.data.points, found.confidence))
        self._data, self._frames = [scene.data], scene.frames.tolist()
        problem = self._tracking.problem
        self._run = OnlineRun(
            self._tracking.filter,
            jax.random.key(settings.seed),
            problem.observations,
            problem.inputs,
            collect=self._tracking.collect,
            predict=self._tracking.predict,
            on_failure=settings.on_failure,
            note=note,
            frame_numbers=self._frames,
        )
        self.estimate = self._estimate(self._frames, self._run.first)

    def add(self, frame: KeypointFrame) -> LiveEstimate:
        """Take the next frame; where the joints are in it.

        Raises:
            RunError: The run cannot go on.
        """
        data = self._seen(frame)
        problem = with_frames(self._tracking.problem, data, 1)
        kept = self._run.add(problem.observations, problem.inputs, [frame.number])
        self._data.append(data)
        self._frames.append(frame.number)
        return self._estimate([frame.number], kept)

    def whole(self) -> Tracking:
        """All frames so far, as one problem: run as a recording, it gives the same."""
        noise = np.concatenate([data.noise for data in self._data])
        data = self._data[0]._replace(points=np.concatenate([data.points for data in self._data]), noise=noise)
        scene = self._tracking.scene._replace(data=data, frames=np.array(self._frames))
        problem = with_frames(self._tracking.problem, data, len(self._frames))
        return self._tracking._replace(scene=scene, problem=problem)

    def finish(self, **attributes: Any) -> xr.DataTree:
        """The result of all frames, before its checks."""
        return self.whole().result(self._run.finish(), **attributes)

    def _estimate(self, frames: Sequence[int], kept: StepOutput) -> LiveEstimate:
        """Outputs of frames; for all statures if one is assumed."""
        outputs, scene = kept.outputs, self._tracking.scene
        lower, upper = (outputs.summary["markers_quantile"][:, end] for end in _ENDS)
        assumed = scene.data.provenance.get(ATTRIBUTE)
        if assumed is not None and len(scene.camera_names) == 1:
            draws = outputs.extras["markers"]  # (T, chains, draws, K, 3)
            scale = stature_draws(assumed, draws.shape[1:3])[..., None, None] / assumed[0]
            lower, upper = np.quantile(along_rays(draws, scene.cameras.centre[0], scale), [0.05, 0.95], axis=(1, 2))
        return LiveEstimate(list(frames), outputs.summary["markers_mean"], lower, upper)

    def _seen(self, frame: KeypointFrame) -> PointData:
        """The person's points in a frame, and their noise."""
        scene, found = self._tracking.scene, self._found
        sizes = found.sizes.astype(int).tolist()
        seen = zip(scene.camera_names, sizes, frame.people, strict=True)
        people = [self._people(*each, frame.number) for each in seen]
        points, confidence = points_of(people, self._person.choose(people))
        known = found.detector_errors or (found.point_errors if self._noise is None else self._noise)
        if isinstance(known, DetectorErrors | PointErrors):  # their unit is mm
            new = triangulate(scene.cameras, points, confidence)[0]
            self._places = np.where(np.isfinite(new), new, self._places)
        noise = noise_of_points(known, scene.body, scene.cameras, found.errors.scale, self._places[None], confidence)
        return PointData(points, noise)

    def _people(self, name: str, size: Sequence[int], people: list[Floats] | None, number: int) -> DetectedPeople:
        """The people that a camera sees in a frame: nobody, and a report, where its file cannot be used."""
        found = _nobody([number], self._layout, self._names)
        try:
            found = _laid_out({number: people or []}, self._layout, Location(field=name)) or found
        except InputError as error:
            self._note(f"frame {number}: {error}; {name} sees nobody there")
        found, strays = without_strays(found, (size[0], size[1]), name)
        if strays and name not in self._strays:  # once is enough
            self._strays.add(name)
            self._note(strays[0])
        return with_markers(found, self.markers)


def _last_known(places: Floats) -> Floats:
    """The last known place (K, 3) of each of K points in places (T, K, 3); NaN where there is none."""
    last = np.full(places.shape[1:], np.nan)
    for place in places:
        last = np.where(np.isfinite(place), place, last)
    return last


def _first_people(
    folders: Mapping[str, FilePath], frames: Sequence[KeypointFrame], layout: str | None
) -> dict[str, DetectedPeople]:
    """Detections of the cameras in the first frames.

    Raises:
        InputError: Nobody was seen, or people have different points, or points of no layout.
    """
    found = {}
    for camera, (name, folder) in enumerate(folders.items()):
        people = {frame.number: frame.people[camera] or [] for frame in frames}
        found[name] = _laid_out(people, layout, Location(folder))
    known = next((each for each in found.values() if each is not None), None)
    if known is None:
        raise InputError(f"nobody was found in any of {len(frames)} frames", field=Argument("files"), expected="a person")
    numbers = [frame.number for frame in frames]
    return {name: each or _nobody(numbers, known.layout, known.names) for name, each in found.items()}


def _laid_out(people: Mapping[int, list[Floats]], layout: str | None, at: Location) -> DetectedPeople | None:
    """People of frames that follow each other; None where there is nobody.

    Raises:
        InputError: They have different points, or points of no layout.
    """
    seen = {number: [each for each in found if np.nan_to_num(each[:, :2]).any()] for number, found in people.items()}
    return with_layout(same_points(seen, at), layout, at) if any(seen.values()) else None


def _nobody(frames: Sequence[int], layout: str, names: tuple[str, ...]) -> DetectedPeople:
    """Frames in which nobody is."""
    shape = len(frames), 1, len(names)
    return DetectedPeople(np.full((*shape, 2), np.nan), np.zeros(shape), np.array(frames), layout, names)
