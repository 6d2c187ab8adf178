from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import xarray as xr
from poseppl_papers.choo_fleet import EXPERIMENT
from poseppl_papers.choo_fleet.claims import claims
from poseppl_papers.choo_fleet.plan import PUBLISHED_UPDATES
from poseppl_papers.experiment import Part
from poseppl_papers.page import page_of
from poseppl_papers.reproduction import reproduce
from poseppl_papers.tables import RECORD, Kept, Provenance, Table, read_folder, write_folder

from poseppl.errors import InputError

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "choo-fleet-2001"
MADE = Provenance("12", "walk", "2026-01-02", "jax 0.0", "poseppl reproduce", "by hand")


def test_the_committed_folder_decides_every_claim():
    kept = read_folder(FOLDER)
    assert {f"{name}.csv" for name in kept} == {path.name for path in FOLDER.glob("*.csv")}
    found = claims({name: each.table for name, each in kept.items()})
    sections = ["Time at equal variance", "Least particles", "log-likelihood", "log prior", "Best step size"]
    assert [sum(claim.what.startswith(each) for claim in found) for each in sections] == [3, 6, 4, 4, 2]
    page = (FOLDER / "page.md").read_text(encoding="utf-8")
    assert all(f"({path.name})" in page for path in FOLDER.glob("*.png")) and len(list(FOLDER.glob("*.png"))) == 6
    assert kept["variances"].made.runs == "50" and kept["contest"].made.runs == "20" and kept["tuning"].made.runs == "10"


def test_pages_of_papers_lead_to_the_errata(tmp_path):
    assert "[errata](../validation/errata.md)" in page_of(EXPERIMENT, FOLDER)
    write_folder(tmp_path, {})
    assert "errata" not in page_of(EXPERIMENT, tmp_path)  # a link that would lead nowhere


def test_settings_that_were_not_timed_alone_are_not_reported():
    """A smaller size than the paper's has fewer settings."""
    tables = {name: kept.table for name, kept in read_folder(FOLDER).items()}
    assert any("timed alone" in claim.why for claim in claims(tables))
    variances = tables["variances"]
    fewer = variances._replace(rows=[row for row in variances.rows if row[3:5] != ("hmc", PUBLISHED_UPDATES)])
    assert len(fewer.rows) < len(variances.rows)
    found = claims({**tables, "variances": fewer})
    assert any("times as long" in claim.why for claim in found) and not any("timed alone" in claim.why for claim in found)


PARTS = {
    "single-frame": ("variances", "coordinates", "speed_ups", "volumes", "references"),
    "reference": ("reference_check",),
    "sequence": ("sequence", "sequence_summary"),
    "tuning": ("tuning", "autocorrelation", "burn_in"),
    "contest": ("contest", "contest_sequences"),
}


def without_jobs(part: Part, tables: list[Table]) -> Part:
    """A part whose tables are there already."""
    return Part(part.about, lambda *_: {}, lambda *_: tables, runs=part.runs, all_recordings=part.all_recordings)


@pytest.mark.full
def test_a_call_with_one_part_keeps_the_others(tmp_path):
    kept = read_folder(FOLDER)
    made = {part: [kept[name].table for name in names] for part, names in PARTS.items()}
    parts = {name: without_jobs(part, made[name]) for name, part in EXPERIMENT.parts.items()}
    for part in PARTS:
        reproduce(EXPERIMENT._replace(parts=parts), tmp_path, parts=[part])
    found = read_folder(tmp_path)
    assert {name: each.made.runs for name, each in found.items()} == {name: each.made.runs for name, each in kept.items()}
    committed, page = page_of(EXPERIMENT, FOLDER), page_of(EXPERIMENT, tmp_path)
    assert [line for line in page.splitlines() if line.startswith("| ") and "poseppl" not in line] == [
        line for line in committed.splitlines() if line.startswith("| ") and "poseppl" not in line
    ]
    assert found["contest_sequences"].made.recordings == "walk, simulated"
    with xr.open_datatree(tmp_path / "tables.nc", engine="h5netcdf") as tree:
        assert set(tree.children) == set(kept)


@pytest.mark.parametrize(("name", "old", "new"), [("volumes", "0.834061", "1.834061"), ("contest", "0.0124717", "0.124717")])
def test_another_number_in_a_table_is_another_page(tmp_path, name, old, new):
    folder = tmp_path / "folder"
    shutil.copytree(FOLDER, folder)
    path = folder / f"{name}.csv"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    assert page_of(EXPERIMENT, folder) != page_of(EXPERIMENT, FOLDER)


def test_tables_stay_when_others_are_written(tmp_path):
    first = Table("first", ("name", "count", "value"), [("a, b", 3, 0.25), ("c", 4, float("inf"))], "About it.")
    write_folder(tmp_path, {"first": Kept(first, MADE)})
    write_folder(tmp_path, {"second": Kept(Table("second", ("x",), [(1,)]), MADE._replace(runs="7"))})
    found = read_folder(tmp_path)
    assert found["first"] == Kept(first, MADE) and found["second"].made.runs == "7"
    write_folder(tmp_path, {"first": Kept(first._replace(rows=[("d", 5, 0.5)]), MADE._replace(runs="9"))})
    found = read_folder(tmp_path)
    assert found["first"].table.rows == [("d", 5, 0.5)] and found["first"].made.runs == "9" and "second" in found


def test_names_that_python_reads_as_numbers_stay_names(tmp_path):
    table = Table("walks", ("recording", "error"), [("02_01", 3.5), ("1_0.5", 4)], "About it.")
    write_folder(tmp_path, {"walks": Kept(table, MADE)})
    assert read_folder(tmp_path)["walks"].table == table


@pytest.mark.full
@pytest.mark.parametrize("damage", ["{", '{"gone": {"about": ""}}', "[]"])
def test_a_damaged_record_is_reported(tmp_path, damage):
    (tmp_path / RECORD).write_text(damage)
    with pytest.raises(InputError, match="run again"):
        read_folder(tmp_path)
