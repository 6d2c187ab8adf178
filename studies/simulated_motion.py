"""Does the default tracker keep the modes of motion that the model itself simulates? Errors of single sequences.

    python -m studies.simulated_motion [--quick] [--sequences 260] [--setting NAME] [--output simulated-motion]

Sequences are those of the contest of Choo and Fleet 2001 (:mod:`poseppl_papers.choo_fleet.sequence`), which takes the first 20:
25 frames at 30 Hz of the 28-DOF body, one camera at 5 m, and an independent random walk for each.

The default represents the past by 3 Gaussians, and shares chains among modes by the power 0.75 of their masses. Its rival,
which keeps lesser modes for longer, has 6 Gaussians and the power 0.5. The third has 12 Gaussians, 150 chains and 400 starts;
the fourth has 60 chains that are eight times as long. These two are the best approximations of the posterior that we can
afford. No filter beats the posterior mean on average. A row is a sequence: mean error of the markers, coverage of their
coordinates, and processor seconds a frame, with scoring. Rows in simulated_motion.csv in the folder are reused.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from poseppl_papers.choo_fleet.sequence import SequenceRuns, run_sequence
from poseppl_papers.choo_fleet.systems import SIMULATED
from poseppl_papers.tables import Table

from benchmarks.timing import arguments, show
from studies.kept_runs import keep_run, read_runs

LONG_CHAINS = {"num_updates": 200, "num_leapfrog": 12, "num_warmup": 60}
SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "default": {},
    "lesser modes kept": {"num_components": 6, "mode_power": 0.5},
    "nearly exact": {"num_components": 12, "mode_power": 0.5, "num_chains": 150, "num_starts": 400},
    "long chains, 12 Gaussians": {"num_components": 12, "mode_power": 0.5, "num_chains": 60, "num_starts": 80, **LONG_CHAINS},
}
COLUMNS = ("setting", "sequence", "error", "in_50", "in_90", "seconds")
_ABOUT = "Mean error of the markers (mm), shares of their coordinates in central intervals, processor seconds a frame."


def study(name: str, sequence: int, num_frames: int) -> tuple[Any, ...]:
    """One row."""
    settings = tuple(sorted(SETTINGS[name].items()))
    job = SequenceRuns(SIMULATED, "full_body", name, "assumed-density", settings, num_frames, (sequence,))
    began = time.process_time()
    found = run_sequence(job)
    seconds = (time.process_time() - began) / num_frames
    inside = np.mean(found["inside_markers"][0], -1)
    return name, str(sequence), *(f"{value:.5g}" for value in (found["error"].mean(), *inside, seconds))


def main() -> None:
    """Run all settings on the same sequences, in turns; a first run of each compiles."""
    options = arguments(__doc__, sequences=260, setting="", output="simulated-motion")
    count, num_frames = (2, 5) if options.quick else (options.sequences, 25)
    table = Table("simulated_motion", COLUMNS, read_runs(options.output / "simulated_motion.csv"), _ABOUT)
    done = {tuple(row[:2]) for row in table.rows}
    names = [options.setting] if options.setting else list(SETTINGS)
    for name in names:
        study(name, 0, num_frames)
    for sequence in range(count):
        for name in names:
            if (name, str(sequence)) not in done:
                keep_run(table, study(name, sequence, num_frames), options.output)
    shown = []
    for name in names:
        own = np.array([row[2:] for row in table.rows if row[0] == name], float)
        values = (own[:, 0].mean(), own[:, 0].max(), *(100 * own[:, 1:3].mean(0)), own[:, 3].mean())
        shown.append([name, *(f"{value:.3g}" for value in values)])
    show("Simulated motion", ("", "error, mm", "largest", "in 50 %", "in 90 %", "s a frame"), shown)


if __name__ == "__main__":
    main()
