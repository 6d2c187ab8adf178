"""Laws of every experiment: its jobs, its parts and its page hang together."""

from __future__ import annotations

import pytest
from poseppl_papers.catalogue import EXPERIMENTS, find_experiment
from poseppl_papers.page import page_of


@pytest.fixture(params=EXPERIMENTS)
def experiment(request):
    return find_experiment(request.param)


def test_it_is_called_as_the_catalogue_calls_it(experiment):
    assert EXPERIMENTS[experiment.name].startswith("poseppl_papers.")
    assert experiment.quick != experiment.full and experiment.parts
    assert all(part.about and part.runs(experiment.full) >= part.runs(experiment.quick) for part in experiment.parts.values())


@pytest.mark.full
def test_its_page_of_nothing_makes_no_claim(experiment, tmp_path):
    page = page_of(experiment, tmp_path)
    assert page.startswith(f"# {experiment.title}") and "## Claims" not in page and experiment.departures in page
