"""Which of the gate's long stages run now: the oldest first, as many as fit into the time for them.

    python .ci/rotation.py begin            count a run, and print how long ago each stage ran
    python .ci/rotation.py next SECONDS     the name of the next stage, with so many seconds left; nothing if there is none
    python .ci/rotation.py done STAGE SECONDS    note that a stage has passed, and how long it took

The oldest stage runs even if it takes longer than the time that is left. So does one that has waited for `LONGEST_WAIT` runs.
The record is kept beside the compiled programs. Only the gate writes it. A machine without a record begins at a stage that
depends on the number of commits.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple, TypedDict

STAGES = {
    "full 1/4": 6,
    "site": 10,
    "mutants 1/9": 4,
    "slow 1/8": 8,
    "lowest": 5,
    "mutants 2/9": 4,
    "full 2/4": 6,
    "mutants 3/9": 4,
    "slow 2/8": 8,
    "newest": 5,
    "wheel 3.11": 7,
    "wheel 3.12": 7,
    "wheel 3.13": 7,
    "slow 3/8": 8,
    "mutants 4/9": 4,
    "full 3/4": 6,
    "mutants 5/9": 4,
    "slow 4/8": 8,
    "package": 2,
    "slow 5/8": 8,
    "mutants 6/9": 4,
    "full 4/4": 6,
    "mutants 7/9": 4,
    "slow 6/8": 8,
    "mutants 8/9": 4,
    "slow 7/8": 8,
    "mutants 9/9": 4,
    "slow 8/8": 8,
}
"""In the order of a machine without a record, with the minutes that each takes on two cores with an empty compile cache."""
LONGEST_WAIT = 6
"""Runs of the gate."""
RECORD = Path(os.environ.get("POSEPPL_CI_RECORD", Path.home() / ".cache" / "poseppl" / "gate.json"))


class Passed(TypedDict):
    """The last run in which a stage passed, and its seconds."""

    run: int
    seconds: float


class Record(NamedTuple):
    """The number of this run, the stages that have passed by name, and those that this run has taken."""

    run: int
    passed: dict[str, Passed]

    def age(self, stage: str) -> int | None:
        """Runs since a stage passed; None if it is not known to have passed."""
        return self.run - self.passed[stage]["run"] if stage in self.passed else None

    def seconds(self, stage: str) -> float:
        """What a stage is expected to take."""
        return self.passed[stage]["seconds"] if stage in self.passed else 60.0 * STAGES[stage]

    def waiting(self) -> list[str]:
        """The stages that have not passed in this run, the oldest first."""
        names = list(STAGES)
        begin = self.run % len(names)
        names = names[begin:] + names[:begin]
        ages = {name: self.age(name) for name in names}
        return sorted((name for name in names if ages[name] != 0), key=lambda name: -(ages[name] or LONGEST_WAIT - 1))

    def next(self, left: float) -> str | None:
        """The stage to run with so many seconds left."""
        waiting = self.waiting()
        begun = any(self.age(name) == 0 for name in STAGES)
        for name in waiting:
            if not begun or (self.age(name) or 0) >= LONGEST_WAIT or self.seconds(name) <= left:
                return name
        return None


def read() -> Record:
    """The record, or an empty one."""
    try:
        known = json.loads(RECORD.read_text(encoding="utf-8"))
        return Record(int(known["run"]), {name: known["passed"][name] for name in STAGES if name in known["passed"]})
    except (OSError, ValueError, KeyError, TypeError):
        commits = subprocess.run(["git", "rev-list", "--count", "HEAD"], capture_output=True, text=True, check=False).stdout
        return Record(int(commits or 0), {})


def write(record: Record) -> None:
    """Write the record whole or not at all."""
    RECORD.parent.mkdir(parents=True, exist_ok=True)
    draft = RECORD.with_suffix(".draft")
    draft.write_text(json.dumps(record._asdict(), indent=1), encoding="utf-8")
    draft.replace(RECORD)


def table(record: Record) -> str:
    """How long ago each stage ran, and what it is expected to take."""
    lines = [f"run {record.run}; the oldest stages come first:"]
    for name in record.waiting():
        age = record.age(name)
        when = "not run on this machine" if age is None else f"{age} runs ago"
        lines.append(f"  {name:12} {when:24} some {record.seconds(name) / 60:.0f} min")
    return "\n".join(lines)


def main(command: str, *arguments: str) -> None:
    """Run a command."""
    record = read()
    if command == "begin":
        record = record._replace(run=record.run + 1)
        write(record)
        print(table(record))
    elif command == "next":
        print(record.next(float(arguments[0])) or "")
    elif command == "done":
        stage, seconds = arguments
        write(record._replace(passed=record.passed | {stage: Passed(run=record.run, seconds=float(seconds))}))
    else:
        raise SystemExit(__doc__)


if __name__ == "__main__":
    main(*sys.argv[1:])
