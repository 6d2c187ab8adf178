"""Run mutants: apply each to a copy of the sources and see whether the tests that it names notice.

    python tests/mutants/run.py                  all mutants
    python tests/mutants/run.py --tier default   with the tests of the default tier alone, or "full"
    python tests/mutants/run.py --part 2/6       a sixth, so that six runs have seen all
    python tests/mutants/run.py NAME NAME        these

The named tests also run on the sources without a mistake, where they must pass. A table and the share of the mutants that were
noticed are printed. The status is 1 if the share is below `--minimum`, a mutant does not apply, or a test fails anyway.
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
from functools import partial
from pathlib import Path
from typing import NamedTuple

from mutant import ROOT, Mutant, apply, copy_tree, import_paths, read_mutants

TIME_LIMIT = 600.0
NOTICED, MISSED, EXCUSED, BROKEN = "noticed", "MISSED", "excused", "BROKEN"
MINIMUM = {"default": 0.8, "full": 0.95, "slow": 0.95}
"""Share of the mutants that the tests of a tier, and of those before it, have to notice."""
_OPTIONS = {"default": [[]], "full": [["--full"]], "slow": [["--full"], ["-m", "slow", "--slow"]]}
"""Arguments of pytest's runs for each tier, one after the other."""
_NO_TESTS = 5


class Outcome(NamedTuple):
    """Result for a mutant: its verdict, its seconds, and a note."""

    mutant: Mutant
    verdict: str
    seconds: float
    note: str


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; its exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="mutants; all if none is named")
    parser.add_argument("--part", default="1/1", help="k/n: every n-th mutant from the k-th on")
    parser.add_argument("--tier", choices=MINIMUM, default="slow", help="the last tier whose tests run; slow by default")
    parser.add_argument("--processes", type=int, default=2, help="mutants that run side by side")
    parser.add_argument("--minimum", type=float, help="share of the mutants that must be noticed; the tier's by default")
    options = parser.parse_args(arguments)
    minimum = MINIMUM[options.tier] if options.minimum is None else options.minimum
    number, parts = (int(part) for part in options.part.split("/"))
    mutants = read_mutants(options.names)[number - 1 :: parts]
    with ThreadPoolExecutor(options.processes) as pool:
        sound = pool.submit(_check_unmutated, mutants, options.tier)
        outcomes = [show(outcome) for outcome in pool.map(partial(try_mutant, tier=options.tier), mutants)]
        complaint = sound.result()
    tested = [outcome for outcome in outcomes if outcome.verdict != EXCUSED]
    noticed = sum(outcome.verdict == NOTICED for outcome in tested)
    broken = sum(outcome.verdict == BROKEN for outcome in tested)
    share = noticed / len(tested) if tested else 1.0
    excused = len(outcomes) - len(tested)
    print(f"{noticed} of {len(tested)} mutants noticed ({share:.0%}; tier {options.tier}), {excused} excused, {broken} broken")
    if complaint:
        print(f"the named tests fail without a mistake, too:\n{complaint}")
    return int(share < minimum or broken > 0 or bool(complaint))


def show(outcome: Outcome) -> Outcome:
    """Print a line of the table."""
    print(f"{outcome.verdict:8} {outcome.seconds:5.0f} s  {outcome.mutant.name:28} {outcome.mutant.wrong}", flush=True)
    if outcome.verdict in (MISSED, BROKEN):
        print(f"{'':18}{outcome.note}", flush=True)
    return outcome


def try_mutant(mutant: Mutant, tier: str) -> Outcome:
    """Apply a mutant to a copy of the sources and run its tests, up to those of a tier."""
    if mutant.reason:
        return Outcome(mutant, EXCUSED, 0.0, mutant.reason)
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="poseppl-mutant-") as folder:
        copy = copy_tree(Path(folder))
        try:
            apply(mutant, copy)
        except ValueError as error:
            return Outcome(mutant, BROKEN, 0.0, str(error))
        status, output = run_tests(copy, mutant.tests, tier)
    seconds = time.monotonic() - start
    if status == 1:
        return Outcome(mutant, NOTICED, seconds, "")
    if status == 0 or (status == _NO_TESTS and tier != "slow"):
        return Outcome(mutant, MISSED, seconds, ", ".join(mutant.tests) if status == 0 else f"no test of the tier {tier}")
    return Outcome(mutant, BROKEN, seconds, f"pytest ended with {status}: {' '.join(output.split())[-300:]}")


def run_tests(folder: Path, tests: Sequence[str], tier: str) -> tuple[int, str]:
    """Run tests of a copy of the sources up to the first failure: pytest's status, 124 when out of time, and its output."""
    status, output = _NO_TESTS, ""
    for options in _OPTIONS[tier]:
        ended, text = _run_pytest(folder, [*options, *tests])
        if ended != _NO_TESTS:
            status, output = ended, text
        if status not in (0, _NO_TESTS):
            break
    return status, output


def _run_pytest(folder: Path, arguments: Sequence[str]) -> tuple[int, str]:
    paths = [*import_paths(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    data = os.environ.get("POSEPPL_DATA", str(ROOT.parent / "shared" / "data"))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "POSEPPL_DATA": data}
    command = [sys.executable, "-m", "pytest", "-x", "-p", "no:cacheprovider", "--tb=line", *arguments]
    try:
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, timeout=TIME_LIMIT, check=False
        )
    except subprocess.TimeoutExpired:
        return 124, f"out of time after {TIME_LIMIT:.0f} s"
    skipped = " skipped" in done.stdout and " passed" not in done.stdout and done.returncode == 0
    return (2, "the tests are skipped here") if skipped else (done.returncode, done.stdout + done.stderr)


def _check_unmutated(mutants: Sequence[Mutant], tier: str) -> str:
    """Run the named tests on the sources without a mistake; what fails, if anything."""
    tests = sorted({test for mutant in mutants for test in mutant.tests})
    if not tests:
        return ""
    with tempfile.TemporaryDirectory(prefix="poseppl-unmutated-") as folder:
        status, output = run_tests(copy_tree(Path(folder)), tests, tier)
    return "" if status in (0, _NO_TESTS) else output[-3000:]


if __name__ == "__main__":
    sys.exit(main())
