"""Calls of whole experiments: plans before jobs, one count of all jobs, and results that are of the source at hand."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from job_samples import Draw, draw
from poseppl_papers.experiment import Experiment, Jobs, Part, Results, Task
from poseppl_papers.recordings import BUILT_IN, Recording
from poseppl_papers.reproduction import reproduce
from poseppl_papers.tables import RECORD, Table

from poseppl.errors import InputError
from poseppl.jobs import job, run
from poseppl.jobs.job import source_hash


class Listener:
    """Records its calls."""

    def __init__(self) -> None:
        self.told: list[Any] = []

    def started(self, total: int, done: int, cost: float) -> None:
        self.told.append((total, done, cost))

    def finished(self, cost: float) -> None:
        self.told.append(cost)

    def note(self, message: str) -> None:
        self.told.append(message)


def first(scale: Any, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Costs 1 and 3; the second part shares one of them."""
    return {"few": Task(draw, [Draw(0), Draw(2)])}


def second(scale: Any, recordings: Sequence[Recording]) -> dict[str, Task]:
    return {"shared": Task(draw, [Draw(2)]), "more": Task(draw, [Draw(9), Draw(19)])}


def of_two(scale: Any, recordings: Sequence[Recording]) -> dict[str, Task]:
    if len(recordings) < 2:
        raise InputError("one walk", field="--motion", expected="two")
    return first(scale, recordings)


def tabulate(jobs: Jobs, results: Results) -> list[Table]:
    return [Table("means", ("mean",), [(float(each["mean"]),) for each in results.values()])]


def experiment(**plans: Any) -> Experiment:
    parts = {name: Part("a test", plan, tabulate, runs=lambda scale: 1) for name, plan in plans.items()}
    return Experiment("toy", "Toy", "Here.", "- None.", 2, 1, parts, lambda tables: [])


def test_all_jobs_are_counted_together(tmp_path: Path) -> None:
    listener = Listener()
    reproduce(experiment(a=first, b=second), tmp_path, executor="inline", progress=listener)
    assert listener.told == [(4, 0, 4.0), 1.5, 0.5, pytest.approx(4 / 3), pytest.approx(2 / 3)]
    (next((tmp_path / "jobs").glob("draw-9-*"))).unlink()
    again = Listener()
    reproduce(experiment(a=first, b=second), tmp_path, executor="inline", progress=again)
    assert again.told == [(4, 3, pytest.approx(2 / 3)), pytest.approx(2 / 3)]


def test_recordings_are_not_enough_for_a_part_before_the_first_job(tmp_path: Path) -> None:
    toy, walk, listener = experiment(a=first, b=of_two), Recording("walk", "walk.amc"), Listener()
    told = r"the part b cannot be run: --motion: one walk \(expected two\); without it: poseppl reproduce toy a$"
    with pytest.raises(InputError, match=told):
        reproduce(toy, tmp_path, recordings=[walk], executor="inline", progress=listener)
    with pytest.raises(InputError, match="the part b cannot be run"):
        reproduce(toy, tmp_path, parts=["b"], executor="inline", progress=listener)
    assert not listener.told and not list(tmp_path.iterdir())
    assert reproduce(toy, tmp_path, parts=["a"], recordings=[walk], executor="inline")
    assert reproduce(toy, tmp_path, recordings=[walk, walk], executor="inline")


def test_the_built_in_walk_leaves_out_what_it_is_not_enough_for(tmp_path: Path) -> None:
    listener = Listener()
    reproduce(experiment(a=of_two, b=first), tmp_path, recordings=[BUILT_IN], executor="inline", progress=listener)
    assert listener.told[0] == "the part a is left out: --motion: one walk (expected two)"
    assert listener.told[1] == (2, 0, 2.0)


def test_results_of_another_source_are_computed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    toy = experiment(a=first)
    told = []
    for source in ("0.1+a", "0.1+b", "0.1+b"):
        monkeypatch.setattr(run, "versions", lambda source=source: {"poseppl": source})
        listener = Listener()
        reproduce(toy, tmp_path, executor="inline", progress=listener)
        told.append(listener.told)
    assert told[0][0] == told[1][0] == (2, 0, 2.0) and told[2] == [(2, 2, 0)]
    assert ['"0.1+a"}); computed again' in note for note in told[1][1:3]] == [True, True]


def test_a_table_says_which_source_made_it(tmp_path: Path) -> None:
    reproduce(experiment(a=first), tmp_path, executor="inline")
    made = json.loads((tmp_path / RECORD).read_text())["means"]["versions"]
    assert f"poseppl {job.versions()['poseppl']}" in made and "+" in made.split(", ")[0]


def test_the_hash_is_that_of_all_that_decides_results(tmp_path: Path) -> None:
    for name in ("package/a.py", "package/motion/b.py", "package/cli/c.py", "package/report/d.py", "package/walk.json"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1")
    folder = tmp_path / "package"
    before = source_hash([folder])
    for name, decides in (
        ("a.py", True),
        ("motion/b.py", True),
        ("walk.json", True),
        ("cli/c.py", False),
        ("report/d.py", False),
    ):
        (folder / name).write_text("2")
        assert (source_hash([folder]) != before) == decides, name
        (folder / name).write_text("1")
    (folder / "motion" / "b.py").rename(folder / "b.py")
    assert source_hash([folder]) != before
