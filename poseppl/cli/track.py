"""The command `poseppl track`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from poseppl.cli.checks import InputFile, check_inputs, number
from poseppl.cli.keypoint_words import words_of_keypoints
from poseppl.cli.options import (
    OF_PLACED_CAMERAS,
    OF_RECORDINGS,
    camera_options,
    chosen,
    common_options,
    history_option,
    max_draws_option,
    refuse,
    seed_option,
    subject_options,
)
from poseppl.cli.overlay import overlay_paths
from poseppl.cli.settings import check_algorithm, settings_option
from poseppl.cli.subject import check_noise, check_subject
from poseppl.cli.track_keypoints import (
    check_keypoint_usage,
    check_kind_of_keypoints,
    exported_targets,
    keypoint_options,
    keypoint_scene,
    wants_points,
    write_exported,
)
from poseppl.cli.track_live import live_table, tell_lines_left, track_live
from poseppl.cli.track_smooth import check_smooth_usage, goes_straight, smooth_option, smoothed, smoothed_target
from poseppl.cli.track_video import (
    ManyFiles,
    check_video_usage,
    open_sources,
    scene_of_options,
    video_options,
    write_overlays,
)
from poseppl.errors import PosepplError

_SETTINGS = ("sigma_position", "sigma_angle", "walk", "markers", "prior", "seed", "max_draws", "history_mib", "devices")
"""Settings of a track that are options of the same names."""

EXAMPLES = """
\b
Examples:
  poseppl track
      The built-in walk, seen by one camera at 5 m.
  poseppl track 02_01.amc --skeleton 02.asf --frames 0:200:2 --cameras 2
      Every second of the first 200 frames of a recording, seen by two cameras.
  poseppl track walk.bvh --filter hmc --set num_chains=50 --set num_updates=64 --set num_warmup=10
      The filter of Choo and Fleet 2001, with more and longer chains.
  poseppl track --observations points.csv --camera camera.toml
      2-D points that carry no truth, from poseppl simulate or a detector.
  poseppl track --keypoints cam1=pose/cam1 cam2=pose/cam2 --calibration Calib.toml --rate 60
      A person in a detector's keypoints: OpenPose, AlphaPose, MMPose, MediaPipe, DeepLabCut, SLEAP.
  poseppl track --keypoints cam1=pose/cam1 cam2=pose/cam2 --calibration Calib.toml --rate 60 --live
      The same while the detector is at work, frame by frame.
  poseppl track --video cam1.mp4 cam2.mp4 --calibration Calib.toml --background cam1=a.png cam2=b.png
      A person's silhouettes in two videos, whose empty scenes are known.
  poseppl track walk.bvh --smooth trajectory
      Smoothed, too: every frame given all, by NUTS on all frames at once.
  poseppl track long.amc --skeleton long.asf --checkpoint run/
      Saved as it goes; the same command with --resume continues it after a crash.

\b
Files written:
  poseppl-NAME.nc   the result: an xarray DataTree that ArviZ takes as it is
  poseppl-NAME.png  a picture of it
  poseppl-NAME-METHOD.nc  smoothed, each frame given all, and its picture: with --smooth, and of
                    keypoints by laplace, or assumed-density in one camera, unless --online;
                    of several cameras' keypoints the only result, unless --filter, --set or
                    --checkpoint ask for a filter's
  poseppl-NAME-METHOD.trc, .mot  of keypoints, unless --no-export: joints and angles for OpenSim, as
                    poseppl export writes them, with _lower.trc and _upper.trc, the ends of intervals
  poseppl-NAME_live.csv  of --live: a line a frame as it comes: joints in mm with 90 % intervals
  poseppl-NAME-CAMERA.mp4  of videos, each with the skeletons over it
NAME is the input's, or walk, and -person2 of --person 2. Older ones of the same name are replaced; inputs never are. Each
appears whole or not at all; a result for which there is no room goes into another folder, and
one of a run that cannot go on holds the frames up to there.

\b
Exit status: 0 done, 1 bad input or a run that cannot go on, 2 wrong usage, 130 Ctrl-C, 143 SIGTERM.
"""


@click.command(cls=ManyFiles, epilog=EXAMPLES, short_help="Track a body in 2-D markers, keypoints or videos.")
@click.argument("recording", required=False, type=InputFile())
@click.option(
    "--observations",
    metavar="CSV",
    type=InputFile(),
    help="2-D points to track instead of a recording: columns frame, marker, x, y, and where wanted camera and confidence; "
    "absent rows are missing markers. Needs --camera.",
)
@subject_options
@camera_options
@video_options
@keypoint_options
@click.option(
    "--filter",
    "filter_name",
    metavar="NAME",
    help="Which algorithm; poseppl filters lists them. [default: kalman for markers, assumed-density for --video and for "
    "--keypoints of one camera or with --online, switching with --prior; recorded keypoints of several cameras are smoothed "
    "without a filter]",
)
@settings_option
@smooth_option
@click.option(
    "--sigma-position",
    metavar="MM",
    type=number("a positive number", lambda sigma: 0 < sigma < 1e6),
    help="Random walk of translations: standard deviation of a second's motion, mm; of a step, times the root of its time. "
    "[default: the body's, 82: 15 a frame at 30 Hz]",
)
@click.option(
    "--sigma-angle",
    metavar="RAD",
    type=number("a positive number", lambda sigma: 0 < sigma < 1e6),
    help="Random walk of angles: the same in radians. [default: the body's, 0.82: 0.15 a frame at 30 Hz]",
)
@click.option(
    "--walk",
    type=click.Choice(["fixed", "learned", "mean-reverting"]),
    help="Scales of the random walk: those above, or those of each joint that the whole recording is most likely under; or "
    "angles come back to how people hold themselves, and the root's scales are learned: for fast motion in one camera. "
    "[default: mean-reverting for --keypoints of one camera, unless the scales above are given; otherwise fixed]",
)
@click.option(
    "--markers",
    type=click.Choice(["fixed", "learned"]),
    default="fixed",
    show_default=True,
    help="Where markers sit on the body: where it has them, or where the whole recording is most likely to, for points in two "
    "cameras or more.",
)
@click.option(
    "--prior",
    metavar="FILE.nc",
    type=InputFile(),
    help="A learned activity of poseppl fit-motion in place of the random walk. The filter is then switching, and the body "
    "its own but for videos, unless others are asked for. Frames in which it does not hold are told.",
)
@click.option(
    "--prior-alone",
    is_flag=True,
    help="With --prior: nothing but the learned activity, as --filter activity-guided needs it.",
)
@seed_option("Of the noise and of the filter.")
@click.option(
    "--devices",
    metavar="N",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="JAX devices that share the particles or chains, such as GPUs; one CPU is no faster as several.",
)
@max_draws_option
@history_option
@click.option("--output", "-o", metavar="DIR|FILE.nc", help="Where the result goes. [default: poseppl-NAME.nc, here]")
@click.option("--checkpoint", metavar="DIR", type=click.Path(), help="Save the run in this folder as it goes.")
@click.option("--resume", is_flag=True, help="Go on with the run that --checkpoint holds, if it holds one.")
@click.option(
    "--on-failure",
    type=click.Choice(["continue", "stop"]),
    default="continue",
    show_default=True,
    help="At a frame of impossible data: predict it and go on, or stop. Videos: go on without cameras that see nobody, "
    "and up to where one ends or cannot be decoded; or stop there.",
)
@common_options
def track(recording: str | None, observations: str | None, **options: Any) -> None:
    """Track a body in 2-D markers or in silhouettes, frame by frame, with intervals.

    RECORDING is a motion capture file (.bvh, .c3d, .trc; .amc, DeepMimic's or exponential maps' .txt with --skeleton): its
    joints are seen through cameras with noise, as 17 markers a frame, and the result is compared with the truth. Without
    it, a built-in walk is tracked. Observations without a truth come by --observations and --camera, a detector's keypoints by
    --keypoints and videos by --video, both with --calibration.

    Lengths are in mm, angles in radians, times in seconds.
    """
    from poseppl.cli.console import ConsoleProgress, print_table, print_verdicts, start_jax
    from poseppl.cli.files import check_new_folder, check_writable, output_path
    from poseppl.cli.outputs import summary, write_outputs
    from poseppl.cli.subject import stem_of
    from poseppl.threads import spare_threads

    spare_threads(options["devices"])  # here, since bodies start JAX as they are imported
    straight = goes_straight(options)
    options["filter_name"] = _filter_of(options)
    _check_usage(recording, observations, options)
    words = [str(word).rpartition("=")[2] for name in ("video", "background", "occlusion", "masks") for word in options[name]]
    words += words_of_keypoints(options["keypoints"]).values()
    stem = stem_of(recording or observations or (words[0] if words else None), options["person"])
    target = output_path(options["output"], stem, ".nc")
    straight = straight and not wants_points(options)
    target = smoothed_target(options, target) or target if straight else target
    picture = target.with_suffix(".png")
    tables = [options[name] for name in ("prior", "skeleton", "names", "lengths", "camera", "calibration", "detector_errors")]
    inputs = [recording, observations, *tables, *words]
    check_writable([target, picture, *live_table(options, target)], inputs)
    if options["checkpoint"]:
        check_new_folder(options["checkpoint"], "--checkpoint")
    check_kind_of_keypoints(options)
    later = None if straight or wants_points(options) else smoothed_target(options, target)
    beside = [] if later is None else [later, later.with_suffix(".png")]
    check_writable([*beside, *exported_targets(options, later or target)], inputs)
    sources = open_sources(options) if options["video"] else None
    overlays = overlay_paths(sources.videos, target) if sources else []
    check_writable(overlays, inputs)
    progress = ConsoleProgress(options["quiet"])
    start_jax(options["devices"])
    if wants_points(options):
        from poseppl.cli.track_points import track_points

        with progress.running():
            track_points(options, target, progress)
        return
    try:
        with progress.running():
            tree, problem, scene = _run(recording, observations, sources, options | {"straight": straight}, target, progress)
            progress.stage("drawing")
            files = write_outputs(tree, target, progress.note)
            files += [("frame by frame", path) for path in live_table(options, target)]
            if sources:
                files += write_overlays(tree, sources, target, progress)
            shown, place, written = tree, target, {target: tree}
            if later and (best := smoothed(tree, scene, options, progress)) is not None:
                files += [(f"smoothed {name}", path) for name, path in write_outputs(best, later, progress.note)]
                shown, place, written = best, later, {target: tree, later: best}
            files += write_exported(shown, place, options, progress)
    except (KeyboardInterrupt, OSError) as error:
        tell_lines_left(options, target, progress)
        if options["checkpoint"] and isinstance(error, KeyboardInterrupt):
            progress.note(f"the frames done so far are in {options['checkpoint']}; the same command with --resume goes on")
        raise
    if not options["quiet"]:
        print_table("poseppl track", [*summary(tree), *((name, str(path)) for name, path in files)])
    print_verdicts(written, options["quiet"])
    if problem is not None:
        raise PosepplError(f"{problem} in {target}")


def _check_usage(recording: str | None, observations: str | None, options: dict[str, Any]) -> None:
    if recording is not None and observations is not None:
        raise click.UsageError("give a RECORDING or --observations, not both")
    points = recording is not None or observations is not None
    check_video_usage(options, points or bool(options["keypoints"]))
    check_keypoint_usage(options, points)
    check_smooth_usage(options)
    if options["prior_alone"] and not options["prior"]:
        raise click.UsageError("--prior-alone goes with --prior")
    if options["resume"] and options["checkpoint"] is None:
        raise click.UsageError("--resume needs --checkpoint DIR")
    if observations is not None:
        if options["camera"] is None:
            raise click.UsageError("--observations needs --camera TOML")
        refuse((*OF_RECORDINGS, *OF_PLACED_CAMERAS, "up"), "does not go with --observations")
    elif options["stature"] is not None and not options["video"] and not options["keypoints"]:
        raise click.UsageError("--stature goes with --video, --observations or --keypoints; a recording tells its own")
    if not (observations or options["video"] or options["keypoints"]):
        check_subject(recording, options)
    check_noise(options)
    check_algorithm("filter", options["filter_name"], options["settings"])
    if options["smooth_method"]:
        check_algorithm("smoother", options["smooth_method"])
    check_inputs()


def _filter_of(options: dict[str, Any]) -> str:
    """The filter that is asked for, or else that of what is seen; see docs/choosing.md."""
    usual = "assumed-density" if options["keypoints"] or options["video"] else "kalman"
    return str(options["filter_name"] or ("switching" if options["prior"] else usual))


def _run(
    recording: str | None, observations: str | None, sources: Any, options: dict[str, Any], target: Path, progress: Any
) -> tuple[Any, str | None, Any]:
    """The result, why it ends before its scene does, if it does, and the scene, where it was all there."""
    from poseppl.cli.files import tell_replaced
    from poseppl.motion.io import read_cameras
    from poseppl.motion.silhouettes.video_sources import DEFAULT_MODEL as SILHOUETTES
    from poseppl.motion.tracking import (
        TrackSettings,
        TrackStopped,
        observe_motion,
        scene_of_observations,
        smooth_recording,
        track,
    )
    from poseppl.motion.tracking.default_body import DEFAULT_MODEL
    from poseppl.motion.tracking.walk import ASSUMED_RATE
    from poseppl.runs.algorithms import FILTERS

    if options["prior"]:
        _choose_for_prior(options)
    model = options["model"] or (SILHOUETTES if options["video"] else DEFAULT_MODEL)
    settings = TrackSettings(
        model=model,
        filter=options["filter_name"],
        options=options["settings"],
        on_failure=options["on_failure"],
        other_motion=not options["prior_alone"],
        **chosen(options, *_SETTINGS),
    )
    FILTERS[options["filter_name"]].check(settings.options)
    if options["live"]:
        return *track_live(options, settings, target, progress), None
    progress.stage("reading")
    scene: Any
    if sources:
        scene = scene_of_options(sources, options, progress)
    elif options["keypoints"]:
        scene = keypoint_scene(options, model, progress)
    elif observations is not None:
        scene = scene_of_observations(
            observations,
            read_cameras(options["camera"]),
            model=model,
            rate=options["rate"],
            **chosen(options, "frames", "noise", "stature", "lengths"),
        )
    else:
        scene = observe_motion(*_seen(recording, options, progress), **chosen(options, "noise", "seed"))
    if scene.rate is None:
        progress.note(f"nobody says how many frames a second there are: {ASSUMED_RATE:g} are assumed (--rate)")
    if not options["checkpoint"]:
        tell_replaced(target, progress)
    if options["straight"]:
        progress.stage(f"smoothing {len(scene.frames)} frames")
        return smooth_recording(scene, settings), None, scene
    progress.stage("compiling", total=len(scene.frames))
    try:
        tree = track(scene, settings, progress=progress, checkpoint=options["checkpoint"], resume=options["resume"])
        return tree, None, scene
    except TrackStopped as stopped:
        done = stopped.result["posterior"].sizes["frame"]
        return stopped.result, f"{stopped}; the frames before it, {done} of {len(scene.frames)}, are", scene


def _choose_for_prior(options: dict[str, Any]) -> None:
    """Take the body that goes with a learned prior, where no other is asked for."""
    from poseppl.motion.learned import read_motion_model
    from poseppl.motion.tracking.learned_prior import SILHOUETTE_NOISE
    from poseppl.motion.tracking.recorded_model import installed_builder

    known = read_motion_model(options["prior"])
    if options["video"]:
        given = options["silhouette_noise"]
        options["silhouette_noise"] = SILHOUETTE_NOISE if given is None else given
    elif options["model"] is None:
        installed_builder(known.body)
        options["model"] = known.body


def _seen(recording: str | None, options: dict[str, Any], progress: Any) -> tuple[Any, Any, tuple[str, ...]]:
    from poseppl.cli.subject import find_subject, look_at_subject

    if recording is not None:
        progress.stage("fitting the body to the recording")
    subject = find_subject(recording, options, progress.note)
    return subject, *look_at_subject(subject, options)
