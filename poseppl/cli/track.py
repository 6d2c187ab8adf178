"""The command `poseppl track`: a command for each source, of which `poseppl track FILE...` takes that of the files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, replace
from typing import Any

import click

from poseppl.cli.checks import InputFile, check_inputs, check_recording, file_of_pair, words_of_files
from poseppl.cli.options import BY_SET, Grouped, common_options, made, option_group, options_of, text_of
from poseppl.cli.settings import ManyFiles, check_algorithm, filter_of_prior, settings_option
from poseppl.cli.track_dispatch import dispatched
from poseppl.cli.track_live import track_live
from poseppl.cli.track_run import Wanted, goes_straight, track_points, track_source
from poseppl.motion.keypoints.settings import KeypointSettings, LiveSettings
from poseppl.motion.points.settings import PointSettings
from poseppl.motion.recordings.settings import ObservationSettings, RecordingSettings
from poseppl.motion.settings import Settings, TrackSettings, kinds_of
from poseppl.motion.silhouettes.settings import VideoSettings
from poseppl.runs.settings import Setting

OF_TRACK = ("filter", "walk", "prior", "max_draws", "seed")
"""Settings of a track that are options; others are given by `--set`."""
_ABSENT = {"keypoints": (), "live": ("markers", "other_motion"), "videos": ("markers", "export")}
"""Keys of `--set` that a source does not have."""
SMOOTH_PRIORS = ("backward-simulation", "forward-backward")
"""Smoothers of the particles of a learned motion."""
EXPORT = Setting("export", bool, False, True, "Whether joints and angles are written for OpenSim, too.")
STATUS = """
\b
Exit status: 0 done, 1 bad input or a run that cannot continue, 2 wrong usage, 130 Ctrl-C, 143 SIGTERM.
"""
_KEPT = """  poseppl-NAME.nc   the result: an xarray DataTree for ArviZ
  poseppl-NAME.png  a picture of it
"""
EXAMPLES = f"""
\b
Examples:
  poseppl track                                          the built-in walk, seen by one camera at 5 m
  poseppl track recording 02_01.amc --skeleton 02.asf    a recorded walk, seen by one camera
  poseppl track keypoints cam1=pose/cam1 cam2=pose/cam2 --calibration Calib.toml --rate 60
  poseppl track live cam1=pose/cam1 cam2=pose/cam2 --calibration Calib.toml --rate 60
  poseppl track points Cam-A=a.csv Cam-B=b.csv --calibration calibration.toml --skeleton fly.toml
  poseppl track videos cam1.mp4 cam2.mp4 --calibration Calib.toml --background cam1=a.png cam2=b.png
  poseppl track observations points.csv --camera camera.toml
  poseppl track walk.bvh --filter hmc --set num_chains=50    a recording, recognised by its file

\b
Files written:
{_KEPT}and further files of each source. NAME is the input's, or walk, and -person2 of --person 2. Older ones of the
same name are replaced; inputs never are. Each appears whole or not at all; a result for which there is no room
goes into another folder, and one of a run that cannot go on has the frames up to there.
{STATUS}"""
_SMOOTHED = """  poseppl-NAME-METHOD.nc, .png  the smoothed result, with --smooth
"""
_STRAIGHT = """  Several cameras' keypoints are smoothed without a filter: poseppl-NAME-laplace.nc is then the only
                    result, unless --filter, --set of a filter, --checkpoint or --smooth ask for a filter
"""
_EXPORTED = """  poseppl-NAME-METHOD.trc, .mot, .osim  joints, angles and a model for OpenSim, as poseppl export
                    writes them, with _lower.trc and _upper.trc, the ends of intervals
"""


class SourceCommand(ManyFiles):
    """The command of a source: help in sections, and an option of another source is answered with that source."""

    def settings(self) -> set[str]:
        """Names that `--set` takes."""
        return super().settings() | set(BY_SET)

    def elsewhere(self, option: str) -> str | None:
        """Which sources have an option."""
        having = [name for name, other in track.commands.items() if any(option in each.opts for each in other.params)]
        return f"{option} is an option of poseppl track {' and '.join(having)}" if having else None

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the options by section, and what `--set` takes."""
        sections: dict[str, list[tuple[str, str]]] = {name: [] for name in ("Input", "Method", "Output")}
        for option in self.get_params(ctx):
            record = option.get_help_record(ctx)
            if isinstance(option, click.Option) and record is not None:
                section = "Method" if option.name == "settings" else getattr(option, "section", "Output")
                sections[section].append(record)
        if any(option.name == "settings" for option in self.params):
            sections["Settings of --set, besides those of the filter"] = [(each.shown, each.text) for each in by_set(self)]
        for name, records in sections.items():
            if records:
                with formatter.section(name):
                    formatter.write_dl(records)


class TrackGroup(click.Group):
    """A group whose first word may be left out."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse, as click does, after the source has been found."""
        if not args or args[0] not in (*self.commands, *ctx.help_option_names):
            flags = {
                name for each in self.commands.values() for option in each.params for name in option.opts if _is_flag(option)
            }
            args = dispatched(args, (*flags, *ctx.help_option_names, "--live"))
        return super().parse_args(ctx, args)


def _is_flag(parameter: click.Parameter) -> bool:
    return isinstance(parameter, click.Option) and parameter.is_flag


def by_set(command: click.Command) -> list[Setting]:
    """The settings of a track that `--set` takes for a command."""
    kinds, own = kinds_of(TrackSettings), {each.name: each.default for each in fields(TrackSettings)}
    absent = _ABSENT.get(str(command.name), ("export",))
    return [
        EXPORT if name == "export" else Setting(name, kinds[name].type, own[name] is None, own[name], _usual(name))
        for name in BY_SET
        if name not in absent
    ]


def _usual(name: str) -> str:
    text, _, usual = text_of(TrackSettings, name).partition(" Default: ")
    return f"{text} [default: {usual.rstrip('.')}]" if usual else text


track_options = option_group(
    *options_of(TrackSettings, "filter", section="Method"),
    settings_option,
    click.option(
        "--smooth",
        metavar="METHOD",
        cls=type("OfMethod", (Grouped,), {"section": "Method"}),
        help="Smooth the result, too, each frame given all, by a method of poseppl smoothers; or none. Results of videos have "
        "no pictures and can be smoothed here alone. [default: laplace for keypoints, in place of a filter; assumed-density "
        "for those of one camera; otherwise none]",
    ),
    *options_of(TrackSettings, *OF_TRACK[1:], section="Method"),
)
output_options = option_group(
    click.option(
        "--output", "-o", metavar="DIR|FILE.nc", help="File or folder of the result. [default: poseppl-NAME.nc, here]"
    ),
    common_options,
)
resume_options = option_group(
    click.option(
        "--checkpoint", metavar="DIR", type=click.Path(), help="Save the run in this folder as it goes. [default: none]"
    ),
    click.option("--resume", is_flag=True, help="Continue the run in --checkpoint, if there is one."),
)


@click.group(cls=TrackGroup, epilog=EXAMPLES, short_help="Track a body in 2-D markers, keypoints or videos.")
def track() -> None:
    """Track a body in 2-D markers, keypoints or silhouettes, frame by frame, with intervals.

    Each source has its command and its options: poseppl track SOURCE --help. Without SOURCE it is found from the files: a
    motion capture file is a recording, CAMERA=FILE are keypoints, .mp4 are videos.

    Lengths are in mm, angles in radians, times in seconds.
    """


def source_command(
    name: str, settings: type[Settings], *options: Any, examples: str, written: str = ""
) -> Callable[[Any], Any]:
    """A command of `poseppl track` whose options are the fields of settings, and others."""
    first, kind = fields(settings)[0], kinds_of(settings)[fields(settings)[0].name]
    many, required = kind.several or first.name == "files", first.default is MISSING
    argument = click.argument(
        first.name,
        nargs=-1 if many else 1,
        required=required,
        metavar="CAMERA=FILE..." if first.name == "files" else "FILE..." if many else "FILE" if required else "[FILE]",
        type=InputFile(folders=many, paths=file_of_pair if many else lambda word: [word]),
    )
    epilog = f"\n\b\nExamples:\n{examples}\n\b\nFiles written:\n{_KEPT}{written}{STATUS}"

    def decorate(run: Any) -> Any:
        command = option_group(argument, *options_of(settings, section="Input"), *options, output_options)(run)
        return track.command(name, cls=SourceCommand, epilog=epilog)(command)

    return decorate


@source_command(
    "recording",
    RecordingSettings,
    track_options,
    resume_options,
    examples="""  poseppl track recording 02_01.amc --skeleton 02.asf --frames 0:200:2 --cameras 2
      Every second of the first 200 frames, seen by two cameras.
  poseppl track recording walk.bvh --smooth trajectory
      Smoothed, too: every frame given all, by NUTS on all frames at once.
  poseppl track recording long.amc --skeleton long.asf --checkpoint run/
      Saved as it goes; the same command with --resume continues it after a crash.
""",
    written=_SMOOTHED,
)
def recording(**given: Any) -> None:
    """Track a motion capture recording that simulated cameras see.

    The result is compared with the truth. FILE is a .bvh, .c3d or .trc file or, with --skeleton, an .amc file or a .txt file of
    DeepMimic or of exponential maps. Its joints are seen as 17 markers a frame. Without FILE, a built-in walk is tracked.
    """
    source = made(RecordingSettings, given)
    check_recording(given["recording"], given["skeleton"])
    _track(source, given)


@source_command(
    "observations",
    ObservationSettings,
    track_options,
    resume_options,
    examples="""  poseppl track observations poseppl-walk.csv --camera poseppl-walk.toml
      What poseppl simulate wrote, without the truth.
""",
    written=_SMOOTHED,
)
def observations(**given: Any) -> None:
    """Track 2-D points of a body's markers, without a truth.

    FILE is a table, .csv, with the columns frame, marker, x and y, and optionally camera and confidence. Absent rows are
    missing markers.
    """
    _track(made(ObservationSettings, given), given)


@source_command(
    "keypoints",
    KeypointSettings,
    track_options,
    resume_options,
    examples="""  poseppl track keypoints cam1=pose/cam1 cam2=pose/cam2 --calibration Calib.toml --rate 60
  poseppl track keypoints cam1=pose/cam1 cam2=pose/cam2 --calibration Calib.toml --rate 60
      --camera cam2:offset=3.5,size=960x540 --keep detections
      The second camera is 3.5 frames late, and its detector saw smaller pictures; left and right are the detector's.
""",
    written=_STRAIGHT + _SMOOTHED + _EXPORTED,
)
def keypoints(**given: Any) -> None:
    """Track a person in a detector's keypoints.

    CAMERA=FILE is a camera of the calibration and its keypoints: a file, or a folder of one file a frame. Frames with the
    same number are simultaneous, unless an offset is found. The result is smoothed by default; with several cameras no filter
    runs.
    """
    _track(made(KeypointSettings, given | {"files": words_of_files(given["files"])}), given)


@source_command(
    "live",
    LiveSettings,
    *options_of(TrackSettings, "filter", section="Method"),
    settings_option,
    *options_of(TrackSettings, "walk", "max_draws", "seed", section="Method"),
    examples="""  poseppl track live cam1=pose/cam1 cam2=pose/cam2 --calibration Calib.toml --rate 60
""",
    written="""  poseppl-NAME_live.csv  a line a frame as it comes: joints in mm with 90 % intervals
"""
    + _EXPORTED,
)
def live(**given: Any) -> None:
    """Track a person while a detector runs.

    CAMERA=FILE is a camera and the folder that a detector is writing to, one OpenPose or MMPose file a frame. The run ends with
    Ctrl-C or after --idle seconds without a frame; then the result is written. It has 20 draws unless --max-draws asks for
    more. Frames with the same number are simultaneous, and left and right are the detector's.
    """
    if given["walk"] == "learned":
        raise click.UsageError("--walk learned needs the whole recording, and does not go with live")
    source = made(LiveSettings, given | {"files": words_of_files(given["files"])})
    track_live(source, *_settings(source, given, "assumed-density"))


@source_command(
    "points",
    PointSettings,
    examples="""  poseppl track points Cam-A=a.csv Cam-B=b.csv --calibration calibration.toml --skeleton fly.toml --rate 100
""",
)
def points(**given: Any) -> None:
    """Smooth named points of an animal or a thing.

    Each point is smoothed by itself, or with the points that a skeleton links it to. CAMERA=FILE is a camera of the calibration
    and a file of a detector that names its points, such as DeepLabCut or SLEAP.
    """
    source = made(PointSettings, given | {"files": words_of_files(given["files"])})
    check_inputs()
    track_points(source, Wanted(given["output"], export=False, quiet=given["quiet"]))


@source_command(
    "videos",
    VideoSettings,
    track_options,
    resume_options,
    examples="""  poseppl track videos cam1.mp4 cam2.mp4 --calibration Calib.toml --background cam1=a.png cam2=b.png
  poseppl track videos room/
      A scene of poseppl simulate, compared with its truth.
""",
    written=_SMOOTHED + "  poseppl-NAME-CAMERA.mp4  the videos with the skeletons over them\n",
)
def videos(**given: Any) -> None:
    """Track a person's silhouettes in calibrated videos.

    FILE is a video named as its camera, CAMERA=FILE, a folder of pictures, or the folder of a scene that poseppl simulate
    rendered. Needs pip install 'poseppl[vision]'.
    """
    _track(made(VideoSettings, given), given)


def _track(source: Any, given: Mapping[str, Any]) -> None:
    """Track a source by the options of its command."""
    if given["prior"] and given["smooth"] not in (None, "none", *SMOOTH_PRIORS):
        fit = " or ".join(SMOOTH_PRIORS)
        raise click.UsageError(f"--smooth {given['smooth']} does not go with --prior, whose states are finite: {fit} does")
    if given["resume"] and given["checkpoint"] is None:
        raise click.UsageError("--resume needs --checkpoint DIR")
    if given["smooth"] not in (None, "none"):
        check_algorithm("smoother", given["smooth"])
    detected = isinstance(source, KeypointSettings | VideoSettings)
    settings, wanted = _settings(source, given, "assumed-density" if detected else "kalman")
    if not settings.other_motion and settings.prior is None:
        raise click.UsageError("--set other_motion=false goes with --prior")
    track_source(source, settings, wanted)


def _settings(source: Any, given: Mapping[str, Any], usual: str) -> tuple[TrackSettings, Wanted]:
    """How to track, with the usual filter where one is needed and none is asked for, and what to write; files are checked.

    Raises:
        InputError: A setting or a file cannot be used.
    """
    command = click.get_current_context().command
    own, words = {each.name: each for each in by_set(command)}, dict(given["settings"])
    chosen = {name: own[name].read(words.pop(name)) for name in list(words) if name in own}
    wanted = Wanted(
        export=chosen.pop("export", EXPORT.default), **{name: given[name] for name in Wanted._fields if name in given}
    )
    settings = replace(made(TrackSettings, {**given, **chosen}), options=words)
    if settings.prior is not None and settings.filter is None:
        settings = replace(settings, filter=filter_of_prior(str(settings.prior), settings.options))
    elif not goes_straight(source, settings, wanted):
        settings = replace(settings, filter=settings.filter or usual)
        check_algorithm("filter", str(settings.filter), settings.options)
    check_inputs()
    return settings, wanted
