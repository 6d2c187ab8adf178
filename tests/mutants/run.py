"""Run mutants: apply each to a copy of the sources and see whether the tests that it names notice.

    python tests/mutants/run.py                  all mutants
    python tests/mutants/run.py --part 2/12      a twelfth, so that twelve runs in a row have seen all
    python tests/mutants/run.py NAME NAME        these

The named tests also run on the sources as they are, where they have to pass. A table and the share that was noticed
are printed; the status is 1 if it is below `--minimum`, a patch does not apply, or a test is missing or fails anyway.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from mutant import ROOT, Mutant, apply, copy_tree, read_mutants

TIME_LIMIT = 600.0
NOTICED, MISSED, EXCUSED, BROKEN = "noticed", "MISSED", "excused", "BROKEN"


class Outcome(NamedTuple):
    """What became of a mutant: its verdict, the seconds that it took, and what there is to say."""

    mutant: Mutant
    verdict: str
    seconds: float
    note: str


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; its exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="mutants; all if none is named")
    parser.add_argument("--part", default="1/1", help="k/n: every n-th mutant from the k-th on")
    parser.add_argument("--processes", type=int, default=2, help="mutants that run side by side")
    parser.add_argument("--minimum", type=float, default=0.95, help="share of the mutants with tests that must be noticed")
    options = parser.parse_args(arguments)
    number, parts = (int(part) for part in options.part.split("/"))
    mutants = read_mutants(options.names)[number - 1 :: parts]
    with ThreadPoolExecutor(options.processes) as pool:
        sound = pool.submit(_check_unmutated, mutants)
        outcomes = [show(outcome) for outcome in pool.map(try_mutant, mutants)]
        complaint = sound.result()
    tested = [outcome for outcome in outcomes if outcome.verdict != EXCUSED]
    noticed = sum(outcome.verdict == NOTICED for outcome in tested)
    broken = sum(outcome.verdict == BROKEN for outcome in tested)
    share = noticed / len(tested) if tested else 1.0
    print(f"{noticed} of {len(tested)} mutants noticed ({share:.0%}), {len(outcomes) - len(tested)} excused, {broken} broken")
    if complaint:
        print(f"the named tests do not pass on the sources as they are:\n{complaint}")
    return int(share < options.minimum or broken > 0 or bool(complaint))


def show(outcome: Outcome) -> Outcome:
    """Print a line of the table."""
    print(f"{outcome.verdict:8} {outcome.seconds:5.0f} s  {outcome.mutant.name:28} {outcome.mutant.wrong}", flush=True)
    if outcome.verdict in (MISSED, BROKEN):
        print(f"{'':18}{outcome.note}", flush=True)
    return outcome


def try_mutant(mutant: Mutant) -> Outcome:
    """Apply a mutant to a copy of the sources and run its tests."""
    if mutant.reason:
        return Outcome(mutant, EXCUSED, 0.0, mutant.reason)
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="poseppl-mutant-") as folder:
        copy = copy_tree(Path(folder))
        problem = apply(mutant, copy)
        if problem:
            return Outcome(mutant, BROKEN, 0.0, f"the patch no longer applies: {problem.splitlines()[0]}")
        status, output = run_tests(copy, mutant.tests)
    seconds = time.monotonic() - start
    if status in (0, 1):
        return Outcome(mutant, NOTICED if status else MISSED, seconds, ", ".join(mutant.tests))
    return Outcome(mutant, BROKEN, seconds, f"pytest ended with {status}: {' '.join(output.split())[-300:]}")


def run_tests(folder: Path, tests: Sequence[str]) -> tuple[int, str]:
    """Run tests of a copy of the sources up to the first failure: pytest's status, 124 where time ran out, and what it says."""
    paths = [str(folder), str(folder / "models"), *filter(None, [os.environ.get("PYTHONPATH")])]
    data = os.environ.get("POSEPPL_DATA", str(ROOT.parent / "shared" / "data"))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "POSEPPL_DATA": data}
    command = [sys.executable, "-m", "pytest", "-x", "--slow", "-p", "no:cacheprovider", "--tb=line", *tests]
    try:
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, timeout=TIME_LIMIT, check=False
        )
    except subprocess.TimeoutExpired:
        return 124, f"out of time after {TIME_LIMIT:.0f} s"
    skipped = " skipped" in done.stdout and " passed" not in done.stdout and done.returncode == 0
    return (5, "the tests are skipped here") if skipped else (done.returncode, done.stdout + done.stderr)


def _check_unmutated(mutants: Sequence[Mutant]) -> str:
    """Run the named tests on the sources as they are; what fails, if anything."""
    tests = sorted({test for mutant in mutants for test in mutant.tests})
    if not tests:
        return ""
    with tempfile.TemporaryDirectory(prefix="poseppl-unmutated-") as folder:
        status, output = run_tests(copy_tree(Path(folder)), tests)
    return "" if status == 0 else output[-3000:]


if __name__ == "__main__":
    sys.exit(main())
