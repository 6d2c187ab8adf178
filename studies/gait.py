"""Events, steps and strides of walks before simulated cameras, against force plates, a laboratory's events, and markers.

    POSEPPL_DATA=FOLDER python -m studies.gait [--quick] [--output studies/tables]

Two people of btk_c3d have optical markers, force plates and the events that the laboratory marked; six people of cmu_walks are
known by their skeletons. They walk in front of four cameras 5 m away, in which a detector's points are drawn
(poseppl.motion.keypoints.drawn_detections), 50 or 60 frames a second. These are smoothed as ``poseppl track
keypoints`` does, and events are those of ``poseppl gait``. Beside them stand events of the same rule in the markers themselves:
what they miss is the rule's, not the cameras'. Other speeds at which a heel strikes are compared: the walking speed, which it
has when it is foremost (Zeni et al. 2008), 0.78 of that (Bruening and Ridge 2014), and half of the default.

A force plate's contact is where its vertical force is above 20 N. Gaps of less than 50 ms are closed, and contacts of less than
100 ms are left out, because a plate rings at toe-off. An event is compared with the nearest of its kind and foot within 0.2 s.
Steps and strides are compared one by one; their lengths are between the heels' markers at the reference's events.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import ezc3d
import numpy as np
from poseppl_papers.tables import Table
from scipy.ndimage import binary_closing
from scipy.stats import t as student

from benchmarks.timing import DATA, arguments, show, write_table
from poseppl.arrays import Floats
from poseppl.cli.console import start_jax
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.keypoints.drawn_detections import detect
from poseppl.motion.keypoints.scene import scene_of_keypoints
from poseppl.motion.keypoints.settings import KeypointSettings
from poseppl.motion.recordings.subjects import recorded_subject
from poseppl.motion.tracking.default_body import FOOTED_MODEL
from poseppl.motion.tracking.gait import WORDS, between_feet, gait_of, heel_path, steps_of, strides_of, time_between
from poseppl.motion.tracking.gait_events import STRIKE, GaitEvent, Kind, WalkDraws, gait_events, walk_draws
from poseppl.motion.tracking.placing import cameras_around, records_of_cameras
from poseppl.motion.tracking.smoothed_recording import smooth_recording

PEOPLE = {
    "btk 1": "btk_c3d/PiG_Motion-FlatFoot-Full.c3d",
    "btk 2": "btk_c3d/PiG_Motion3_FF.c3d",
    **{f"cmu {name[:2]}": f"cmu_walks/{name}.amc" for name in ("05_01", "06_01", "07_01", "08_01", "16_15", "35_01")},
}
NEAREST, FORCE, GAP, CONTACT = 0.2, 20.0, 0.05, 0.1
SHARES = (1.0, 0.78, STRIKE, STRIKE / 2)
"""Speeds of a heel that strikes, as shares of the walking speed."""
KINDS: dict[str, Kind] = {"Foot Strike": "strike", "Foot Off": "off"}
Pair = tuple[GaitEvent, GaitEvent]
PAIRS: dict[str, tuple[Callable[[list[GaitEvent]], Iterator[Pair]], Callable[[WalkDraws, GaitEvent, GaitEvent], Floats]]] = {
    "step time, ms": (steps_of, lambda walk, a, b: 1000 * time_between(a, b)),
    "stride time, ms": (strides_of, lambda walk, a, b: 1000 * time_between(a, b)),
    "step length, mm": (steps_of, lambda walk, a, b: 1000 * between_feet(walk, a, b)[0]),
    "stride length, mm": (strides_of, lambda walk, a, b: 1000 * heel_path(walk, a, b)),
    "walking speed, mm/s": (strides_of, lambda walk, a, b: 1000 * heel_path(walk, a, b) / time_between(a, b)),
}
"""Figures of pairs of strikes."""
COLUMNS = (
    *("reference", "method", "strike_share", "figure", "person", "number"),
    *("bias", "bias_lower", "bias_upper", "sd", "largest", "coverage_90", "coverage_lower", "coverage_upper"),
)
ABOUT = (
    "Errors of single events, steps and strides. Of a person, sd and the interval of the bias (95 %, Student's t) are over "
    "steps. Of all, they are over people, as is the interval of the coverage of 90 % intervals."
)
Errors = dict[tuple[str, int], tuple[float, bool]]
"""By figure and number of the event, step or stride: the error, and whether the 90 % interval includes the truth."""


class Reference(NamedTuple):
    """Known events, and the walk whose markers give the lengths between them."""

    name: str
    walk: WalkDraws
    events: list[GaitEvent]


def laboratory(path: Path, walk: WalkDraws) -> Iterator[Reference]:
    """Find the events that a laboratory marked, and those of its force plates."""
    file = ezc3d.c3d(str(path), extract_forceplat_data=True)
    first, parameters = file["header"]["points"]["first_frame"], file["parameters"]
    times = np.asarray(parameters["EVENT"]["TIMES"]["value"]).reshape(2, -1, order="F")[1]
    times = times - first / parameters["POINT"]["RATE"]["value"][0]
    labels, contexts = (parameters["EVENT"][name]["value"] for name in ("LABELS", "CONTEXTS"))
    marked = [
        GaitEvent(KINDS[label], "l" if context == "Left" else "r", np.array([time]))
        for time, label, context in sorted(zip(times, labels, contexts, strict=True))
    ]
    yield Reference("laboratory", walk, marked)
    analog = parameters["ANALOG"]["RATE"]["value"][0]
    loaded = [each for plate in file["data"]["platform"] for each in contacts(plate["force"][2], analog)]
    felt = [(kind, contact[end]) for contact in loaded for end, kind in enumerate(KINDS.values())]
    near = [(min((e for e in marked if e.kind == kind), key=lambda e: abs(e.mean - time)), time) for kind, time in felt]
    yield Reference("force plate", walk, sorted((e._replace(times=np.array([time])) for e, time in near), key=lambda e: e.mean))


def contacts(force: Floats, rate: float) -> list[tuple[float, float]]:
    """From when to when a plate is loaded, s; contacts that begin and end in the recording."""
    gap, least = round(GAP * rate), round(CONTACT * rate)
    on = np.pad(np.abs(force) > FORCE, gap)  # closing takes nothing away at the ends
    on = binary_closing(on, np.ones(2 * (gap // 2) + 1))[gap:-gap].astype(int)
    starts, ends = (np.flatnonzero(np.diff(on) == sign) + 1 for sign in (1, -1))
    pairs = [(start, ends[ends > start][0]) for start in starts if (ends > start).any()]
    return [(start / rate, end / rate) for start, end in pairs if end - start >= least]


def errors_of(reference: Reference, walk: WalkDraws, events: list[GaitEvent]) -> Errors:
    """Errors of events, steps and strides."""
    found: Errors = {}

    def add(figure: str, number: int, off: Floats) -> None:
        low, high = np.nanquantile(off, [0.05, 0.95])
        found[figure, number] = float(np.nanmean(off)), bool(low <= 0 <= high)

    own = [_nearest(event, events) for event in reference.events]
    partner = {id(event): near for event, near in zip(reference.events, own, strict=True) if near is not None}
    for number, event in enumerate(reference.events):
        if id(event) in partner:
            add(f"{WORDS[event.kind]}, ms", number, 1000 * (partner[id(event)].times - event.times))
    for figure, (pairs, of) in PAIRS.items():
        for number, pair in enumerate(pairs(reference.events)):
            if all(id(event) in partner for event in pair):
                first, last = (partner[id(event)] for event in pair)
                add(figure, number, of(walk, first, last) - of(reference.walk, *pair))
    return found


def _nearest(event: GaitEvent, events: list[GaitEvent]) -> GaitEvent | None:
    """The nearest event of its kind and foot, within 0.2 s."""
    alike = [each for each in events if each[:2] == event[:2] and abs(each.mean - event.mean) < NEAREST]
    return min(alike, key=lambda each: abs(each.mean - event.mean), default=None)


def of_cameras(subject: MovingSubject) -> WalkDraws:
    """The walk of the posterior."""
    records = list(records_of_cameras(cameras_around(subject, count=4), 1100.0, (1920, 1080)))
    people = detect(subject, records, np.random.default_rng(0)).people
    found = scene_of_keypoints(KeypointSettings(people, records, rate=subject.rate, keep=("clocks",)))
    return gait_of(smooth_recording(found.scene).result).walk


Key = tuple[str, str, float, str]
"""Reference, method, share and figure."""


def compared(path: Path, frames: str) -> Iterator[tuple[Key, Errors]]:
    """Errors of a person."""
    skeleton = path.with_name(f"{path.stem[:2]}.asf") if path.suffix == ".amc" else None
    subject = recorded_subject(path, skeleton, model=FOOTED_MODEL, frames=frames)
    subject = subject._replace(frames=np.arange(len(subject.states)))
    names, markers = subject.body.tree.marker_names, subject.complete_markers()[None]
    marked = walk_draws(markers, names, subject.frames / subject.rate)
    walks = {"markers": marked, "four cameras": of_cameras(subject)}
    references = [Reference("markers", marked, gait_events(marked))]
    if path.suffix == ".c3d":
        heels = {side: markers[:, :, names.index(f"heel_{side}")] for side in marked.heel}  # without the filter of events
        references += laboratory(path, marked._replace(heel=heels))
    for reference in references:
        for method, walk in walks.items():
            for share in SHARES if reference.name != method else ():
                found = errors_of(reference, walk, gait_events(walk, share))
                for figure in dict.fromkeys(figure for figure, _ in found):
                    if share == STRIKE or (figure == "heel strike, ms" and reference.name != "markers"):
                        yield (reference.name, method, share, figure), {k: v for k, v in found.items() if k[0] == figure}


def interval(values: Floats) -> tuple[float, float, float, float]:
    """Mean, ends of its 95 % interval (Student's t), and SD."""
    mean = float(np.mean(values))
    if len(values) < 2:
        return mean, np.nan, np.nan, np.nan
    spread = float(np.std(values, ddof=1))
    half = float(student.ppf(0.975, len(values) - 1)) * spread / np.sqrt(len(values))
    return mean, mean - half, mean + half, spread


def rows_of(key: Key, people: dict[str, Errors]) -> Iterator[tuple[object, ...]]:
    """A row of each person, and of all where they are several."""
    markers, kept = key[1] == "markers", []
    for person, found in people.items():
        off = np.array([error for error, _ in found.values()])
        inside = np.nan if markers else float(np.mean([held for _, held in found.values()]))
        *figures, worst = *interval(off), float(np.abs(off).max())
        yield (*key, person, len(off), *figures, worst, inside, np.nan, np.nan)
        kept.append((len(off), figures[0], worst, inside))
    if len(people) > 1:
        numbers, biases, largest, shares = (np.array(each) for each in zip(*kept, strict=True))
        yield (*key, "all", int(numbers.sum()), *interval(biases), float(largest.max()), *interval(shares)[:3])


def main() -> None:
    """Print the table and write it."""
    options = arguments(__doc__, output="studies/tables")
    start_jax()
    found: dict[Key, dict[str, Errors]] = {}
    for person, name in list(PEOPLE.items())[: 1 if options.quick else None]:
        for key, errors in compared(DATA / name, "0:240:2" if options.quick else "0::2"):
            found.setdefault(key, {})[person] = errors
    rows = [row for key, people in sorted(found.items()) for row in rows_of(key, people)]
    shown = [
        [each if isinstance(each, str) else f"{each:.3g}" for each in row] for row in rows if options.quick or "all" in row
    ]
    show("Gait", COLUMNS, shown)
    if not options.quick:
        table = Table("gait", COLUMNS, rows, ABOUT)
        write_table(table, Path(options.output), "1 walk a person", "btk_c3d, cmu_walks; simulated cameras")


if __name__ == "__main__":
    main()
