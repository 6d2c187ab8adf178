"""Filters that are advised where particles fail take the model, and nothing is said of weights that are exact."""

from __future__ import annotations

import sys
from pathlib import Path

import jax
import numpy as np
import pytest
from poseppl_models.finite_hmm import finite_hmm

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))

from choosing_models import MODELS  # noqa: E402

from poseppl import infer  # noqa: E402
from poseppl.diagnostics import verdicts  # noqa: E402
from poseppl.filters import hidden_markov_filter, particle_filter  # noqa: E402
from poseppl.filters.suitability import suited_filters, takes  # noqa: E402
from poseppl.runs.algorithms import FILTERS  # noqa: E402
from poseppl.runs.predictive import predictive_checks  # noqa: E402
from poseppl.runs.results import provenance  # noqa: E402
from poseppl.runs.simulation import simulate  # noqa: E402


@pytest.mark.parametrize("name", MODELS)
def test_no_filter_is_advised_that_refuses_the_model(name: str) -> None:
    model = MODELS[name]().model
    suited = suited_filters(model)
    assert suited and all(takes(model, FILTERS[each].builder) for each in suited)


def test_a_filter_that_refuses_a_model_is_known() -> None:
    model = MODELS["switching linear"]().model
    refusing = ("assumed-density", "kalman", "demc", "hidden-markov", "ensemble-kalman")
    assert not any(takes(model, FILTERS[name].builder) for name in refusing)
    assert not takes(MODELS["counts"]().model, FILTERS["assumed-density"].builder)


def test_a_hidden_markov_model_is_advised_what_is_exact_which_is_let_be() -> None:
    model = finite_hmm().compile()
    data = jax.tree.map(np.asarray, simulate(model, jax.random.key(0), 60).values)
    few, exact = (
        infer(model, data, filter, jax.random.key(1), predict=predictive_checks(model))
        for filter in (lambda model: particle_filter(model, 8), hidden_markov_filter)
    )
    assert [each.text for each in verdicts(exact) if each.severity != "info"] == []
    assert provenance(few)["suited filters"] == ["hidden-markov"]
    (told,) = [each.text for each in verdicts(few) if each.text.startswith("Effective number")]
    assert "use --filter hidden-markov" in told
