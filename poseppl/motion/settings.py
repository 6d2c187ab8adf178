"""Settings of tracking: frozen dataclasses that Python and the command line share. Nothing heavy is imported for them.

The types of their fields say what values are accepted, and each is checked as the settings are made:

>>> TrackSettings(seed=-1)
Traceback (most recent call last):
poseppl.errors.InputError: seed: -1 (expected 0 to 4294967295)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from poseppl.declarations import declared
from poseppl.errors import Argument, FilePath, InputError, brief
from poseppl.files.csv_fields import decimal_number
from poseppl.files.frame_range import FrameRange


class Within(NamedTuple):
    """A number, of which only some are accepted.

    Attributes:
        expected: Which, in words.
        accepts: Whether a number is one of them; NaN never is.
        unit: Its unit.
    """

    expected: str
    accepts: Callable[[float], bool]
    unit: str = ""


class Reads(NamedTuple):
    """A word of a form.

    Attributes:
        read: Reads it, or refuses it by an :class:`~poseppl.errors.InputError`.
        metavar: The form, for help.
    """

    read: Callable[[str], Any]
    metavar: str


class ReadFrom(NamedTuple):
    """A file that is read.

    Attributes:
        folders: Whether it may be a folder, or a pattern of files.
    """

    folders: bool = False


_WORDS = "CAMERA:NAME=VALUE, such as cam2:offset=3.5 or cam3:rate=30,size=960x540"


def _check_unit(unit: str) -> None:
    known = declared("poseppl.motion.io.units_and_axes", "MM_PER_UNIT")
    mm = 1.0 if unit in known else decimal_number(unit.strip())
    if mm is None or not 1e-6 <= mm <= 1e6:
        expected = f"{', '.join(known)}, or a number of mm from 0.000001 to 1000000"
        raise InputError(brief(unit), field=Argument("unit"), expected=expected)


def at_least(least: float, unit: str = "") -> Within:
    """Numbers from one on."""
    return Within(f"at least {least:g}{unit and ' '}{unit}", lambda value: value >= least, unit)


def within(low: float, high: float, unit: str = "") -> Within:
    """Numbers of a range, its ends among them."""
    return Within(f"{low:g} to {high:.10g}{unit and ' '}{unit}", lambda value: low <= value <= high, unit)


Builder = Annotated[str, "builder"]
"""A body's builder: ``package.module:builder`` or ``FILE.py:builder``, or a name of an entry point."""
File = Annotated[FilePath, ReadFrom()]
FileOrFolder = Annotated[FilePath, ReadFrom(folders=True)]
Frames = Annotated[str, Reads(FrameRange.parse, "A:B:C")]
Unit = Annotated[str, Reads(_check_unit, "UNIT")]
Rate = Annotated[float, Within("a positive number of frames a second", lambda rate: 0 < rate < 1e6, "Hz")]
Seconds = Annotated[float, at_least(0, "s")]
Stature = Annotated[float, within(500, 2500, "mm")]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Walk = Literal["fixed", "learned", "mean-reverting"]
NOISE = Within("a positive fraction of the focal length, such as 0.003", lambda noise: 0 < noise < 10, "fraction")
Noise = Annotated[float, NOISE]
_Scale = Annotated[float, Within("a positive number", lambda sigma: 0 < sigma < 1e6)]


class OneCamera(NamedTuple):
    """Properties of one camera besides its calibration.

    Attributes:
        offset: Frames by which it is late: what the others have in frame n, it has in frame n + offset.
        rate: Frames a second, where it has others than the recording.
        size: Width and height, px, of the pictures that the detector saw, where they are not of the calibrated size.
    """

    offset: float | None = None
    rate: float | None = None
    size: tuple[int, int] | None = None


def read_cameras(words: Iterable[str]) -> dict[str, OneCamera]:
    """Read words such as ``cam2:offset=3.5,rate=30``, by camera.

    Raises:
        InputError: A word has another form, or a value is out of range.
    """
    found: dict[str, OneCamera] = {}
    for word in words:
        camera, colon, values = str(word).rpartition(":")
        for pair in values.split(","):
            name, _, text = (part.strip() for part in pair.partition("="))
            if not (camera and colon and text) or name not in OneCamera._fields:
                raise InputError(brief(word), field=Argument("camera"), expected=_WORDS)
            if getattr(known := found.get(camera, OneCamera()), name) is not None:
                raise InputError(f"{name} of {brief(camera)} comes twice", field=Argument("camera"), expected="each once")
            value: Any = _size(text, word) if name == "size" else _number(text)
            found[camera] = known._replace(**{name: value})
    return found


def _number(text: str) -> float:
    value = decimal_number(text)
    if value is None or not abs(value) <= 1e9:
        raise InputError(f"{brief(text)} is not a number", field=Argument("camera"), expected=_WORDS)
    return value


def _size(text: str, word: str) -> tuple[int, int]:
    sides = text.lower().split("x")
    if len(sides) != 2 or not all(side.isascii() and side.isdigit() and 1 <= int(side[:7]) <= 100_000 for side in sides):
        raise InputError(brief(word), field=Argument("camera"), expected="CAMERA:size=WxH in px, such as cam2:size=960x540")
    return int(sides[0]), int(sides[1])


@dataclass(frozen=True)
class Settings:
    """Settings whose values are checked by the types of their fields.

    Raises:
        InputError: A value is not accepted; the message names the argument.
    """

    def __post_init__(self) -> None:
        for name, kind in kinds_of(type(self)).items():
            for value in kind.values(getattr(self, name)):
                kind.check(name, value)


class Kind(NamedTuple):
    """Values that a field accepts.

    Attributes:
        type: The type without its conditions; of a tuple that of its items.
        condition: A :class:`Within`, a :class:`Reads`, a :class:`ReadFrom` or a word; None where there is none.
        several: Whether the field is a tuple of such values.
        or_file: Whether a file may stand in place of a number.
    """

    type: Any
    condition: Any = None
    several: bool = False
    or_file: bool = False

    def values(self, given: Any) -> Iterator[Any]:
        """The values that a field's value consists of."""
        if given is not None:
            yield from given if self.several else (given,)

    def check(self, name: str, value: Any) -> None:
        """Refuse a value."""
        choices = get_args(self.type) if get_origin(self.type) is Literal else ()
        if choices and value not in choices:
            raise InputError(brief(value), field=Argument(name), expected=f"one of {', '.join(choices)}")
        if isinstance(self.condition, Reads):
            self.condition.read(value)
        if isinstance(self.condition, Within):
            number = isinstance(value, int | float)
            if not self.condition.accepts(value) if number else not self.or_file:
                shown = f"{value:.10g}" if number else brief(value)
                raise InputError(shown, field=Argument(name), expected=self.condition.expected)


def kinds_of(settings: type[Settings]) -> dict[str, Kind]:
    """Values that each field accepts, by its name."""
    known: Any = settings
    return _kinds(known)


@cache
def _kinds(settings: Any) -> dict[str, Kind]:
    hints = get_type_hints(settings, include_extras=True)
    return {each.name: _kind(hints[each.name]) for each in fields(settings)}


def _kind(hint: Any) -> Kind:
    if get_origin(hint) in (Union, UnionType):
        first, *others = [kind for kind in get_args(hint) if kind is not NoneType]
        return _kind(first)._replace(or_file=bool(others))
    if get_origin(hint) is Annotated:
        kind, condition = get_args(hint)[:2]
        return Kind(kind, condition)
    if get_origin(hint) is tuple:
        return _kind(get_args(hint)[0])._replace(several=True)
    return Kind(hint)


@dataclass(frozen=True)
class TrackSettings(Settings):
    """How a scene is tracked.

    Attributes:
        model: Name of the body's builder, for the record; that of the default body if None.
        filter: Filter; poseppl filters lists them. Default: kalman for markers, assumed-density for keypoints and
            videos; with a prior switching, or particle for one walk. Recorded keypoints of several cameras need none on
            the command line.
        options: Settings of the filter by the names of its arguments, such as ``num_particles``; absent ones are its defaults.
        sigma_position: Random walk of translations: standard deviation of one second's motion, mm. A step of h seconds has
            sqrt(h) times as much. Default: the body's, 82.
        sigma_angle: Random walk of angles: the same in radians. Default: the body's, 0.82.
        walk: Standard deviations of the random walk: "fixed", or "learned": each joint's, by maximum likelihood in the
            recording. With "mean-reverting", for fast motion in one camera, angles return to usual poses,
            and the standard deviations of the root are learned. Default: mean-reverting for keypoints in one camera, otherwise
            fixed.
        markers: Positions of the markers on the body: "fixed", the body's, or "learned" from the whole recording by maximum
            likelihood, for points in two or more cameras.
        prior: File of a learned motion, as poseppl fit-motion writes it, in place of the random walk. Except for
            videos, its body is used unless another one is given. Frames with other motion than a learned activity are
            reported. Default: none.
        other_motion: Whether, with a prior, the motion may be another one, too; the filter activity-guided needs false.
        seed: Seed of the filter, and of the noise of simulated cameras.
        max_draws: Draws stored of each chain, or of all particles; moments use all of them. Default: as many as fit
            into 256 MiB.
        history_mib: Space in the result for the particles or Gaussians from which smoothers start, MiB. A run that needs more
            stores none and reports it.
        chunk: Frames between two parts of a checkpoint. Default: as `run_filter` chooses.
        on_failure: At a frame with zero likelihood, "continue" with its prediction, or "stop". With videos, "continue" also
            leaves out cameras that see nobody, and ends where a video ends or cannot be decoded.
        devices: JAX devices that share the particles or chains, such as GPUs; one CPU is no faster as several.
    """

    model: str | None = None
    filter: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    sigma_position: _Scale | None = None
    sigma_angle: _Scale | None = None
    walk: Walk | None = None
    markers: Literal["fixed", "learned"] = "fixed"
    prior: File | None = None
    other_motion: bool = True
    seed: Annotated[int, within(0, 2**32 - 1)] = 0
    max_draws: Annotated[int, at_least(1)] | None = None
    history_mib: Annotated[float, at_least(0, "MiB")] = 256.0
    chunk: int | None = None
    on_failure: Literal["continue", "stop"] = "continue"
    devices: Annotated[int, at_least(1)] = 1


@dataclass(frozen=True)
class CameraFiles(Settings):
    """Points that a detector found in the pictures of calibrated cameras.

    Attributes:
        files: The points of each camera, by its name in the calibration: a detector's file, or its folder of one file a frame.
            Frames with the same number are simultaneous, unless an offset is found or given.
        calibration: File of the calibrated cameras. In Python also a Calibration, or cameras in mm without an up axis.
        rate: Frames a second. Default: 30, which is reported.
        unit: Unit of length of the calibration: mm, cm, dm, m, in, or how many mm it has. Default: what the file says;
            otherwise found from a person's size, or m, which is reported.
        up: Axis of the calibration that points up. Default: found from a person, and reported; otherwise Z.
        camera: Facts about single cameras, as words CAMERA:NAME=VALUE,... or by name: offset, its delay in frames; rate, frames
            a second; size, WxH px of the detector's pictures. Default: offsets are estimated from a person in
            several cameras; the rate is that of the others, the size that of the calibration.
    """

    files: Mapping[str, Any]
    calibration: FileOrFolder | Any
    rate: Rate | None = None
    unit: Unit | None = None
    up: Axis | None = None
    camera: Mapping[str, OneCamera] | tuple[str, ...] = field(default_factory=dict)

    @property
    def cameras(self) -> Mapping[str, OneCamera]:
        """Properties of single cameras, by name."""
        return self.camera if isinstance(self.camera, Mapping) else read_cameras(self.camera)

    def check_one_clock(self) -> None:
        """Refuse what is known of single cameras' clocks.

        Raises:
            InputError: An offset or a rate is given.
        """
        if any(known.offset is not None or known.rate is not None for known in self.cameras.values()):
            expected = "CAMERA:size=WxH alone"
            raise InputError("frames with the same number are simultaneous", field=Argument("camera"), expected=expected)
