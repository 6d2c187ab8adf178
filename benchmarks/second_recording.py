"""Cost of a session's second recording: people of other lengths share model, filter and compiled programs.

    POSEPPL_DATA=FOLDER python -m benchmarks.second_recording [--frames 24]

Tracks walks of three people of the CMU database, one after the other, with the default filter and one camera; processor seconds
of `track`, seconds of its compilation, and how many programs JAX compiled.
"""

from __future__ import annotations

import time

from jax import monitoring

from benchmarks.timing import DATA, arguments, show
from poseppl.motion.recordings.subjects import recorded_subject
from poseppl.motion.tracking import TrackSettings, observe_motion, track
from poseppl.motion.tracking.placing import camera_names, cameras_around


def main() -> None:
    options = arguments(__doc__, frames=24)
    folder = DATA / "cmu_walks"
    compiled: list[str] = []
    monitoring.register_event_duration_secs_listener(
        lambda event, seconds, **more: compiled.append(event) if "backend_compile" in event else None
    )
    rows = []
    for walk, skeleton in (("07_01", "07"), ("35_28", "35"), ("16_47", "16")):
        subject = recorded_subject(
            folder / f"{walk}.amc", folder / f"{skeleton}.asf", frames=f"0:{5 if options.quick else options.frames}"
        )
        scene = observe_motion(subject, cameras_around(subject, count=1), camera_names(1))
        compiled.clear()
        started = time.process_time()
        tree = track(scene, TrackSettings(filter="assumed-density", max_draws=50)).result
        seconds, count = time.process_time() - started, len(compiled)
        rows.append([walk, f"{seconds:.1f}", f"{float(tree.attrs['compile_seconds']):.2f}", str(count)])
    show("One session", ["recording", "processor s", "s of compilation", "programs"], rows)


if __name__ == "__main__":
    main()
