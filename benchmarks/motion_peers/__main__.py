"""anipose, Pose2Sim, EKS and poseppl on the same keypoints of a real recording: errors, intervals, seconds.

    POSEPPL_DATA=FOLDER python -m benchmarks.motion_peers given|LIBRARY|table [--output motion-peers] [--quick]

Three steps: `given` writes what every library is given; each LIBRARY (anipose, pose2sim, eks, poseppl) answers in an
environment in which it is installed, since they do not agree on versions of JAX and NumPy; `table` scores the answers, prints
them and writes OUTPUT/motion_peers.csv. The first and the last need poseppl, the others NumPy and their library:
`pip install aniposelib==0.8.0`, `pip install pose2sim==0.10.49`, `pip install ensemble-kalman-smoother==4.6.2`.

The recording, its cameras after bundle adjustment and the reference are those of studies/keypoints.py: the man on a beam of
pose2sim_balancing, fourteen joints, which all four cameras' weighted linear triangulation places. That is no truth: it shares
the points of the cameras that are used. Errors of predicted keypoints are in the cameras that were left out. All are given
the same points, the right person's, and each its own defaults; what a library was given beside that says its file. Seconds are
of the processor, in a process's own code (user), of all its threads; of two runs with cameras 1 and 4, and of one with the
others.
Answers that OUTPUT holds are not made again.
"""

from __future__ import annotations

import argparse
import importlib
import resource
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[0] = str(HERE)

from given import TIMED, Answer, read_given  # noqa: E402

LIBRARIES = sorted(file.stem.removeprefix("with_") for file in HERE.glob("with_*.py"))


def processor_seconds() -> float:
    """User seconds of this process and of those that it started and waited for."""
    return sum(resource.getrusage(who).ru_utime for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def answer(library: str, output: Path) -> None:
    """Let a library answer for all sets of cameras, and write those that OUTPUT/answers lacks."""
    module = importlib.import_module(f"with_{library}")
    (output / "answers").mkdir(parents=True, exist_ok=True)
    for cameras, given in read_given(output).items():
        for number, (method, run) in enumerate(module.methods(given).items()):
            path, seconds = output / "answers" / f"{library}-{number}-{cameras}.npz", []
            if path.is_file():
                continue
            for _ in range(2 if cameras == TIMED else 1):
                began = processor_seconds()
                found: Answer = run()
                seconds.append(processor_seconds() - began)
            draws = {} if found.draws is None else {"draws": np.asarray(found.draws, np.float32)}
            whose = {"library": f"{module.NAME} {version(module.PACKAGE)}", "method": method, "cameras": cameras}
            np.savez(path, places=np.asarray(found.places, np.float64), seconds=seconds, **whose, **draws)
            print(cameras, module.NAME, method, *(f"{each:.2f} s" for each in seconds), flush=True)


def main() -> None:
    """Take one of the steps."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.motion_peers", description=__doc__)
    parser.add_argument("step", choices=["given", *LIBRARIES, "table"])
    parser.add_argument("--output", default="motion-peers", help="folder of what is given, answered and scored")
    parser.add_argument("--quick", action="store_true", help="30 frames of cameras 1 and 4")
    options = parser.parse_args()
    output = Path(options.output)
    if options.step in LIBRARIES:
        answer(options.step, output)
        return
    sys.path.append(str(HERE.parent))
    scores = importlib.import_module("scores")
    if options.step == "given":
        scores.give(output, quick=options.quick)
    else:
        scores.score(output, quick=options.quick)


if __name__ == "__main__":
    main()
