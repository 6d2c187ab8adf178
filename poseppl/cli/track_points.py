"""`poseppl track --keypoints` of anything that is no person: named points, smoothed in three dimensions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from poseppl.cli.keypoint_words import calibration_of, words_of_keypoints
from poseppl.cli.options import refuse

_BODYS = (
    "layout",
    "offset",
    "camera_rate",
    "keep_clocks",
    "keep_calibration",
    "keep_detections",
    "online",
    "live",
    "noise",
    "stature",
    "lengths",
    "prior",
    "detector_errors",
    "sigma_position",
    "sigma_angle",
    "walk",
    "markers",
    "filter_name",
    "on_failure",
)
_NOT_WITH = (*_BODYS, "model", "checkpoint")
_DRAWS = 200


def track_points(options: dict[str, Any], target: Path, progress: Any) -> None:
    """Smooth named points and write the result.

    Args:
        options: Of the command.
        target: The result's file.
        progress: Is told of the stages.

    Raises:
        InputError: A file, the calibration or the skeleton cannot be used.
    """
    from poseppl.cli.console import print_table
    from poseppl.cli.files import tell_replaced
    from poseppl.cli.outputs import write_outputs
    from poseppl.motion.io.skeleton_files import read_skeleton
    from poseppl.motion.points.files import read_point_recording, result_of_points
    from poseppl.motion.points.smoothing import smooth_points
    from poseppl.motion.tracking.walk import ASSUMED_RATE

    refuse(_NOT_WITH, "does not go with --keypoints of named points")
    progress.stage("reading")
    skeleton = None if options["skeleton"] is None else read_skeleton(options["skeleton"])
    calibration = calibration_of(options)
    recording = read_point_recording(
        words_of_keypoints(options["keypoints"]),
        calibration.cameras,
        skeleton=skeleton,
        detector=options["detector"],
        person=options["person"] or 1,
        frames=options["frames"],
        rate=options["rate"],
    )
    told = [] if calibration.unit else ["the calibration does not state its unit; metres are assumed (--unit sets it)"]
    told += [] if recording.rate else [f"nobody says how many frames a second there are: {ASSUMED_RATE:g} are assumed (--rate)"]
    for note in (*told, *recording.notes):
        progress.note(note)
    tell_replaced(target, progress)
    progress.stage(f"smoothing {len(recording.names)} points in {len(recording.frames)} frames")
    draws = options["max_draws"] or _DRAWS
    tracks = smooth_points(recording, skeleton=skeleton, num_draws=draws, seed=options["seed"])
    edges = [] if skeleton is None else [link.ends for link in skeleton.links]
    tree = result_of_points(recording, tracks, edges, options["seed"])
    progress.stage("drawing")
    files = write_outputs(tree, target, progress.note)
    if not options["quiet"]:
        spread = tree["summary"].dataset["markers_sd"].median().item()
        rows = [("input", recording.source), ("points", ", ".join(recording.names)), ("frames", f"{len(recording.frames)}")]
        rows += [("cameras", ", ".join(recording.camera_names)), ("standard deviation, median", f"{spread:.3g} mm")]
        print_table("poseppl track", [*rows, *((name, str(path)) for name, path in files)])
