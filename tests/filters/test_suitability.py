"""Filters that are advised where particles fail take the model, and nothing is said of weights that are exact."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from poseppl_models.toys.finite_hmm import finite_hmm
from poseppl_models.toys.linear_gaussian import linear_gaussian

from poseppl import infer, smooth
from poseppl.diagnostics import verdicts
from poseppl.filters import annealed_filter, hidden_markov_filter, particle_filter
from poseppl.filters.suitability import compatible_filters, takes
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.predictive import predictive_checks
from poseppl.runs.results import provenance
from poseppl.runs.simulation import simulate
from poseppl.smoothers import forward_backward_smoother, trajectory_smoother
from studies.choosing_models import MODELS


@pytest.mark.full
@pytest.mark.parametrize("name", MODELS)
def test_no_filter_is_advised_that_refuses_the_model(name: str) -> None:
    model = MODELS[name]().model
    suited = compatible_filters(model)
    assert suited and all(takes(model, FILTERS[each].builder) for each in suited)


@pytest.mark.full
def test_a_filter_that_refuses_a_model_is_known() -> None:
    model = MODELS["switching linear"]().model
    refusing = ("assumed-density", "kalman", "demc", "hidden-markov", "ensemble-kalman")
    assert not any(takes(model, FILTERS[name].builder) for name in refusing)
    assert not takes(MODELS["counts"]().model, FILTERS["assumed-density"].builder)


@pytest.mark.full
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
    assert "use filter='hidden-markov'" in told


@pytest.mark.full
@pytest.mark.parametrize(
    ("filter", "settings", "advice"),
    [
        ("annealed", {}, "use filter='assumed-density'"),
        ("demc", {"target": "likelihood"}, "use target='posterior'"),
        ("demc", {"target": "posterior"}, None),
        ("particle", {}, None),
    ],
)
def test_intervals_of_a_seeker_of_modes_mean_nothing_whatever_the_data(filter: str, settings: dict, advice: str | None) -> None:
    """In frames without data, too, where its particles are draws of the prediction."""
    model = linear_gaussian(2).compile()
    built = FILTERS[filter].build(model, {"num_particles": 100, **settings})[0]
    for data in simulate(model, jax.random.key(0), 5).values, {"y": np.full((5, 2), np.nan)}:
        result = infer(model, jax.tree.map(np.asarray, data), built, jax.random.key(1), attrs={"settings": settings})
        told = [each.text for each in verdicts(result) if "mean nothing" in each.text]
        assert not told if advice is None else advice in told[0] and verdicts(result)[0].severity == "error"


@pytest.mark.slow
def test_only_smoothers_that_draw_again_are_right_after_a_seeker_of_modes() -> None:
    model = linear_gaussian(1).compile()
    data = jax.tree.map(np.asarray, simulate(model, jax.random.key(0), 5).values)
    result = infer(model, data, lambda model: annealed_filter(model, 100), jax.random.key(1))
    bound, free = (
        smooth(result, smoother, jax.random.key(2))
        for smoother in (forward_backward_smoother(model), trajectory_smoother(model, num_chains=2, num_draws=20))
    )
    assert ["mean nothing" in verdicts(each)[0].text for each in (bound, free)] == [True, False]
