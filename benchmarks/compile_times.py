"""What each filter and smoother costs on the 28-DOF body: compilation, frames a second, and memory.

    python benchmarks/compile_times.py [--quick] [--frames 10]

One camera sees the built-in walk. Every algorithm runs at its default settings in a process of its own, without a compile
cache; the largest memory is that of the process, to be compared with that of one which has only loaded the libraries ("none").
"""

from __future__ import annotations

import multiprocessing
from typing import Any

import jax
from timing import arguments, peak_memory, show

from poseppl.motion.geometry import paper_camera
from poseppl.motion.tracking import SmoothSettings, TrackSettings, observe_motion, smooth, track, walking_subject
from poseppl.runs.algorithms import FILTERS, SMOOTHERS
from poseppl.runs.results import provenance

_FILTER_OF = {"rauch-tung-striebel": "kalman", "genealogy": "particle", "fixed-lag": "particle"}


def measure(kind: str, name: str, num_frames: int, options: dict[str, Any], answer: Any) -> None:
    """Run one algorithm and send its seconds of compilation, its frames a second and the largest memory in MiB."""
    jax.config.update("jax_enable_compilation_cache", False)  # type: ignore[no-untyped-call]
    scene = observe_motion(walking_subject(frames=f"0:{num_frames}"), paper_camera((0.0, -5000.0, 1000.0)), ["front"])
    seconds, rate = 0.0, float("nan")
    if kind == "filter":
        known = provenance(track(scene, TrackSettings(filter=name, options=options)))
    elif kind == "smoother":
        known = provenance(smooth(track(scene, TrackSettings(filter=_FILTER_OF.get(name, "kalman"))), SmoothSettings(name)))
    if kind != "none":
        seconds, rate = known["compile_seconds"], num_frames / known["wall_seconds"]
    answer.put((seconds, rate, peak_memory()))


def main() -> None:
    options = arguments(__doc__, frames=10)
    wanted: list[tuple[str, str, dict[str, Any]]] = [("none", "", {})]
    wanted += [("filter", name, {}) for name in FILTERS if name != "hidden-markov"]
    wanted += [("filter", "particle", {"num_particles": 100_000})]
    wanted += [("filter", "guided", {"auxiliary": True}), ("filter", "kalman", {"linearisation": "unscented"})]
    wanted += [("smoother", name, {}) for name in SMOOTHERS if name not in ("genealogy", "fixed-lag")]
    context, rows = multiprocessing.get_context("spawn"), []
    for kind, name, settings in wanted[:2] if options.quick else wanted:
        answer = context.Queue()
        process = context.Process(target=measure, args=(kind, name, options.frames, settings, answer))
        process.start()
        process.join()
        if process.exitcode:
            raise SystemExit(f"{kind} {name} failed")
        seconds, rate, memory = answer.get()
        rows.append([kind, name, str(settings or ""), f"{seconds:.1f}", f"{rate:.1f}", f"{memory:,.0f}"])
        print(*rows[-1], flush=True)
    columns = ["", "", "settings", "compilation, s", "frames/s", "memory, MiB"]
    show(f"28-DOF body, {options.frames} frames", columns, rows)


if __name__ == "__main__":
    main()
