"""Common part of the commands of `poseppl track` after parsing: check the outputs, track, smooth, write, report."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from poseppl.cli.checks import check_new_folder, check_writable, files_read, output_path, stem_of, tell_replaced
from poseppl.cli.export import BY_DEFAULT, write_exports
from poseppl.cli.options import as_options
from poseppl.cli.overlay import overlay_paths
from poseppl.errors import InputError, PosepplError
from poseppl.files.exchange_formats import files_of
from poseppl.files.frame_range import FrameRange
from poseppl.motion.keypoints.settings import KeypointSettings, PersonSettings, smoothed_at_once
from poseppl.motion.points.settings import PointSettings
from poseppl.motion.recordings.settings import RecordingSettings
from poseppl.motion.settings import Settings, TrackSettings
from poseppl.motion.silhouettes.settings import VideoSettings


class Wanted(NamedTuple):
    """Outputs of a track.

    Attributes:
        output: File of the result; by default in the current folder, under the input's name.
        checkpoint: Folder that the run is saved to as it goes.
        resume: Whether the run of that folder goes on.
        smooth: Which smoother is asked for, or none; by default that of the source.
        export: Whether a person's joints and angles go to other programs, too.
        quiet: Whether warnings alone are printed.
    """

    output: str | None = None
    checkpoint: str | None = None
    resume: bool = False
    smooth: str | None = None
    export: bool = True
    quiet: bool = False


class Plan(NamedTuple):
    """Files of a track.

    Attributes:
        target: The result's; that of the smoothed one where no filter runs.
        later: The smoothed result's, beside a filter's; None if there is to be none.
        inputs: Input files, which are never overwritten.
        exports: Whether files for other programs are written.
    """

    target: Path
    later: Path | None
    inputs: list[str]
    exports: bool

    @property
    def results(self) -> list[Path]:
        """The results' files."""
        return [self.target, *([] if self.later is None else [self.later])]

    @property
    def exported(self) -> list[Path]:
        """The files for other programs, of the last result."""
        last = self.results[-1]
        return [path for paths in files_of(last.parent, last.stem, BY_DEFAULT).values() for path in paths] * self.exports


class Written(NamedTuple):
    """Written outputs: results by their files, and rows of the table that lists all files."""

    results: dict[Path, Any]
    rows: list[tuple[str, Path]]


def goes_straight(source: Settings, settings: TrackSettings, wanted: Wanted) -> bool:
    """Whether a recording is smoothed without a filter, which nothing that is wanted asks for."""
    return smoothed_at_once(source, settings) and not (wanted.smooth or wanted.checkpoint or wanted.resume)


def planned(source: Settings, settings: TrackSettings, wanted: Wanted) -> Plan:
    """The files of a track; results can be written, and none is an input.

    Raises:
        InputError: One cannot, or is one.
        PosepplError: The disk is full.
    """
    words = [*files_read(source)]
    walk = isinstance(source, RecordingSettings) and source.recording is None
    stem = stem_of(None if walk else words[0], getattr(source, "person", None))
    target, method = output_path(wanted.output, stem, ".nc"), smoothing_method(source, wanted)
    later = None if method is None else target.with_name(f"{target.stem}-{method}.nc")
    if later is not None and goes_straight(source, settings, wanted):
        target, later = later, None
    plan = Plan(target, later, [*words, *files_read(settings)], wanted.export and isinstance(source, PersonSettings))
    pictures = [path.with_suffix(".png") for path in plan.results]
    check_writable([*plan.results, *pictures, *plan.exported], plan.inputs)
    return plan


def smoothing_method(source: Settings, wanted: Wanted) -> str | None:
    """The smoother that is asked for, or that keypoints get.

    In one camera the likeliest trajectory is far from most that are likely: one that is too near (studies/one_camera.py).
    """
    if wanted.smooth is not None or not isinstance(source, KeypointSettings):
        return None if wanted.smooth == "none" else wanted.smooth
    return "assumed-density" if len(source.files) == 1 else "laplace"


def track_source(source: Any, settings: TrackSettings, wanted: Wanted) -> None:
    """Track what a source names, and write the result.

    Raises:
        PosepplError: A file or a setting cannot be used, the run cannot go on, or a result is not at its place.
    """
    from poseppl.cli.console import ConsoleProgress, start_jax
    from poseppl.threads import spare_threads

    spare_threads(settings.devices)  # here, since bodies start JAX as they are imported
    plan = planned(source, settings, wanted)
    if wanted.checkpoint:
        check_new_folder(wanted.checkpoint, "--checkpoint")
    videos = _opened(source, plan)
    progress = ConsoleProgress(wanted.quiet)
    start_jax(settings.devices)
    try:
        with progress.running():
            tracked, several, problem = _tracked(source, settings, wanted, videos, plan.target, progress)
            overlay = partial(_overlays, tracked.result, videos, plan.target, progress)
            smooth = partial(_smoothed, tracked, source, several, settings, wanted, progress)
            written = write_results(tracked.result, plan, progress, source.model, overlay, smooth)
    except KeyboardInterrupt:
        if wanted.checkpoint:
            progress.note(f"the frames done so far are in {wanted.checkpoint}; the same command with --resume continues")
        raise
    report(written, plan.target, wanted.quiet, problem)


def _opened(source: Any, plan: Plan) -> Any:
    """The videos of a source, whose overlays can be written; None where there are none."""
    if not isinstance(source, VideoSettings):
        return None
    from poseppl.motion.silhouettes.video_sources import open_sources

    videos = open_sources(source)
    check_writable(overlay_paths(videos.videos, plan.target), plan.inputs)
    return videos


def _tracked(
    source: Any, settings: TrackSettings, wanted: Wanted, videos: Any, target: Path, progress: Any
) -> tuple[Any, bool, str | None]:
    """Tracked source, whether several cameras saw it, and the reason if it ends before its scene does."""
    from poseppl.motion.sources import scene_of, with_body
    from poseppl.motion.tracking import TrackStopped, smooth_recording, track
    from poseppl.runs.algorithms import FILTERS

    source, settings = with_body(source, settings)
    straight = goes_straight(source, settings, wanted)
    if not straight:
        FILTERS[str(settings.filter)].check(settings.options)
    of_person = isinstance(source, RecordingSettings) and source.recording is not None
    progress.stage("fitting the body to the recording" if of_person else "reading")
    if videos is not None:
        frames = FrameRange.parse(source.frames)
        known = [video.num_frames for video in videos.videos if video.num_frames is not None]
        stop = min(known) if frames.stop is None and known else frames.stop or 0
        progress.stage("finding silhouettes", total=stop - frames.start)
    scene = scene_of(source, settings, progress.note, videos=videos, advance=progress.advance)
    if not wanted.checkpoint:
        tell_replaced(target, progress)
    several = len(scene.camera_names) > 1
    if straight:
        progress.stage(f"smoothing {len(scene.frames)} frames")
        return smooth_recording(scene, settings), several, None
    progress.stage("compiling", total=len(scene.frames))
    try:
        tracked = track(scene, settings, progress=progress, checkpoint=wanted.checkpoint, resume=wanted.resume)
        return tracked, several, None
    except TrackStopped as stopped:
        done = stopped.tracked.result["posterior"].sizes["frame"]
        problem = f"{as_options(stopped)}; the frames before it, {done} of {len(scene.frames)}, are"
        return stopped.tracked, several, problem


def _smoothed(tracked: Any, source: Any, several: bool, settings: TrackSettings, wanted: Wanted, progress: Any) -> Any:
    """A smoothed result, of keypoints with a detector's autocorrelated errors; None and a report if that fails.

    One camera cannot separate autocorrelated errors from the person's depth: its errors are independent.

    Raises:
        PosepplError: The result, which is written, cannot be smoothed by the method that was asked for.
    """
    from poseppl.motion.tracking import SmoothSettings, smooth
    from poseppl.runs.smoothing import SmoothingError

    progress.stage(f"smoothing {tracked.result['posterior'].sizes['frame']} frames")
    errors: Any = "lasting" if isinstance(source, KeypointSettings) and several else "independent"
    how = SmoothSettings(
        str(smoothing_method(source, wanted)),
        seed=settings.seed,
        max_draws=settings.max_draws,
        model=source.model,
        errors=errors,
    )
    try:
        return smooth(tracked, how)
    except (InputError, SmoothingError) as error:
        if wanted.smooth:
            raise PosepplError(f"not smoothed, but the filter's result is written: {as_options(error)}") from error
        progress.note(f"not smoothed (--smooth none leaves it out): {as_options(error)}")
        return None


def _overlays(tree: Any, videos: Any, target: Path, progress: Any) -> list[tuple[str, Path]]:
    """Write the videos again, with the skeletons over them; those that were drawn."""
    if videos is None:
        return []
    from poseppl.cli.outputs import draw
    from poseppl.motion.rendering.overlay_video import write_overlay

    progress.stage("drawing overlays")
    paths = zip(overlay_paths(videos.videos, target), videos.videos, strict=True)
    return [("overlay", path) for path, video in paths if draw(path, partial(write_overlay, path, tree, video), progress.note)]


def write_results(
    tree: Any, plan: Plan, progress: Any, model: str | None, overlay: Any = list, smooth: Any = lambda: None
) -> Written:
    """Write a result, its pictures, the smoothed result, and the files for other programs.

    Args:
        tree: The result.
        plan: Its files.
        progress: Reports the stages, and failures that cost no result.
        model: Builder of the body, where it is not the usual one.
        overlay: Draws over the videos, and returns rows.
        smooth: Returns the smoothed result, or None.
    """
    from poseppl.cli.outputs import write_outputs

    progress.stage("drawing")
    results, rows = {plan.target: tree}, write_outputs(tree, plan.target, progress.note) + overlay()
    if plan.later is not None and (best := smooth()) is not None:
        results[plan.later] = best
        rows += [(f"smoothed {name}", path) for name, path in write_outputs(best, plan.later, progress.note)]
    if plan.exports:
        progress.stage("exporting")
        last = list(results)[-1]
        try:
            rows += [("for OpenSim", path) for path in write_exports(results[last], last, progress.note, model=model)]
        except PosepplError as error:
            left = "not exported for other programs, but the result is written (--set export=false leaves it out)"
            progress.note(f"{left}: {as_options(error)}")
    return Written(results, rows)


def report(written: Written, target: Path, quiet: bool, problem: str | None) -> None:
    """Print what a track has found and written.

    Raises:
        PosepplError: It ended before its scene did.
    """
    from poseppl.cli.console import print_table, print_verdicts
    from poseppl.cli.outputs import summary

    if not quiet:
        rows = [(name, str(path)) for name, path in written.rows]
        print_table("poseppl track", [*summary(written.results[target]), *rows])
    print_verdicts(written.results, quiet)
    if problem is not None:
        raise PosepplError(f"{problem} in {target}")


def track_points(source: PointSettings, wanted: Wanted) -> None:
    """Smooth named points and write the result.

    Raises:
        InputError: A file, the calibration or the skeleton cannot be used.
    """
    from poseppl.cli.console import ConsoleProgress, print_table, start_jax
    from poseppl.cli.outputs import write_outputs

    plan = planned(source, TrackSettings(), wanted)
    progress = ConsoleProgress(wanted.quiet)
    start_jax()

    from poseppl.motion.points.files import read_point_recording, result_of_points, skeleton_of
    from poseppl.motion.points.smoothing import smooth_points

    with progress.running():
        progress.stage("reading")
        recording, skeleton = read_point_recording(source), skeleton_of(source)
        for note in recording.notes:
            progress.note(note)
        tell_replaced(plan.target, progress)
        progress.stage(f"smoothing {len(recording.names)} points in {len(recording.frames)} frames")
        tracks = smooth_points(recording, skeleton=skeleton, num_draws=source.max_draws, seed=source.seed)
        edges = [] if skeleton is None else [link.ends for link in skeleton.links]
        tree = result_of_points(recording, tracks, edges, source.seed)
        progress.stage("drawing")
        files = write_outputs(tree, plan.target, progress.note)
    if not wanted.quiet:
        spread = tree["summary"].dataset["markers_sd"].median().item()
        rows = [("input", recording.source), ("points", ", ".join(recording.names)), ("frames", f"{len(recording.frames)}")]
        rows += [("cameras", ", ".join(recording.camera_names)), ("standard deviation, median", f"{spread:.3g} mm")]
        print_table("poseppl track", [*rows, *((name, str(path)) for name, path in files)])
