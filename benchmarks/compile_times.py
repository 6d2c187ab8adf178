"""What each filter and smoother costs on the 28-DOF body: compilation, frames a second, and memory.

    python benchmarks/compile_times.py [--quick] [--frames 10] [--only kalman]

One camera sees the built-in walk. Every algorithm runs at its default settings in a process of its own, without a compile
cache; the largest memory is that of the process, to be compared with that of one which has only loaded the libraries ("none").
Processor seconds are those by which a first run takes longer than a second one, which compiles nothing: tracing and compiling,
whatever else the machine does.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
from timing import arguments, peak_memory, show

from poseppl.motion.geometry import paper_camera
from poseppl.motion.tracking import SmoothSettings, TrackSettings, observe_motion, smooth, track, walking_subject
from poseppl.runs.algorithms import FILTERS, SMOOTHERS
from poseppl.runs.results import provenance

_FILTER_OF = {"rauch-tung-striebel": "kalman", "genealogy": "particle", "fixed-lag": "particle"}


def measure(kind: str, name: str, num_frames: int, options: dict[str, Any], answer: Any) -> None:
    """Run one algorithm; send seconds of compilation, processor seconds, frames a second and the largest memory in MiB."""
    jax.config.update("jax_enable_compilation_cache", False)  # type: ignore[no-untyped-call]
    scene = observe_motion(walking_subject(frames=f"0:{num_frames}"), paper_camera((0.0, -5000.0, 1000.0)), ["front"])
    if kind == "none":
        answer.put((0.0, 0.0, float("nan"), peak_memory()))
        return
    filter_name = name if kind == "filter" else _FILTER_OF.get(name, "kalman")
    run: Callable[[], Any] = partial(track, scene, TrackSettings(filter=filter_name, options=options))
    if kind == "smoother":
        run = partial(smooth, run(), SmoothSettings(name))
    (first, compiled), (second, known) = _timed(run), _timed(run)
    answer.put((compiled["compile_seconds"], first - second, num_frames / known["wall_seconds"], peak_memory()))


def _timed(run: Callable[[], Any]) -> tuple[float, dict[str, Any]]:
    """Processor seconds of a run, and what its result tells of it."""
    start = time.process_time()
    known = provenance(run())
    return time.process_time() - start, known


def main() -> None:
    options = arguments(__doc__, frames=10, only="")
    wanted: list[tuple[str, str, dict[str, Any]]] = [("none", "", {})]
    wanted += [("filter", name, {}) for name in FILTERS if name != "hidden-markov"]
    wanted += [("filter", "particle", {"num_particles": 100_000})]
    wanted += [("filter", "guided", {"auxiliary": True}), ("filter", "kalman", {"linearisation": "unscented"})]
    wanted += [("smoother", name, {}) for name in SMOOTHERS if name not in ("genealogy", "fixed-lag")]
    context, rows = multiprocessing.get_context("spawn"), []
    if options.only:
        wanted = [row for row in wanted if row[1] == options.only]
    for kind, name, settings in wanted[:2] if options.quick else wanted:
        answer = context.Queue()
        process = context.Process(target=measure, args=(kind, name, options.frames, settings, answer))
        process.start()
        process.join()
        if process.exitcode:
            raise SystemExit(f"{kind} {name} failed")
        seconds, processor, rate, memory = answer.get()
        rows.append([kind, name, str(settings or ""), f"{seconds:.1f}", f"{processor:.1f}", f"{rate:.1f}", f"{memory:,.0f}"])
        print(*rows[-1], flush=True)
    columns = ["", "", "settings", "compilation, s", "processor s", "frames/s", "memory, MiB"]
    show(f"28-DOF body, {options.frames} frames", columns, rows)


if __name__ == "__main__":
    main()
