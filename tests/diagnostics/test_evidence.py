"""Log-evidence of runs and its Monte Carlo error, against replicates."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from law_problems import run
from poseppl_models.toys.growth import growth
from poseppl_models.toys.linear_gaussian import linear_gaussian

from poseppl.diagnostics import compare
from poseppl.diagnostics.replicates import evidence_of_run, evidence_words
from poseppl.diagnostics.verdicts.comparison import findings
from poseppl.filters import particle_filter
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.results import Names, build_result
from poseppl.runs.simulation import simulate

FRAMES, RUNS, PARTICLES = 60, 60, 500


def result(increments: Any, ess: Any, **attrs: Any) -> xr.DataTree:
    frames = len(increments)
    draws = np.random.default_rng(0).standard_normal((1, 30, frames, 1))
    stats = {"log_evidence": increments, "ess": ess}
    told = {**FILTERS[attrs["filter"]].build(linear_gaussian(1).compile(), {})[0].provenance, **attrs}
    return build_result(state=draws, names=Names(("x",)), sample_stats=stats, num_particles=PARTICLES, attrs=told)


@pytest.mark.full
@pytest.mark.parametrize("which", ["linear", "growth"])
def test_the_error_of_one_run_is_that_of_replicates(which: str) -> None:
    times = jnp.arange(1.0, FRAMES + 1) if which == "growth" else None
    model = growth().compile(1.0) if which == "growth" else linear_gaussian(2).compile()
    data = model.observe(jax.tree.map(np.asarray, simulate(model, jax.random.key(0), FRAMES, times).values))
    filter = particle_filter(model, PARTICLES)
    inputs = jnp.zeros(FRAMES) if times is None else times

    def one(key: jax.Array) -> tuple[jax.Array, jax.Array]:
        _, info = run(filter, key, data, inputs)
        return info.log_evidence, info.ess

    keys = jax.random.split(jax.random.key(1), RUNS)
    increments, ess = map(np.asarray, jax.jit(lambda keys: jax.lax.map(one, keys))(keys))
    totals = increments.sum(1)
    alone = [evidence_of_run(result(increments[index], ess[index], filter="particle")) for index in range(10)]
    np.testing.assert_allclose([found.log_evidence for found in alone], totals[:10], rtol=1e-5)
    errors = [found.standard_error for found in alone]
    # a standard deviation of 60 errs by 9 %; without the sum over frames it would be 8 times too small
    ratio = np.std(totals, ddof=1) / np.mean(errors)
    assert 0.9 - 0.27 < ratio < 1.3 + 0.27


def runs(**extra: xr.DataTree) -> dict[str, xr.DataTree]:
    ess = np.full(10, 100.0)
    return {"good": result(np.full(10, -1.0), ess, filter="particle"), **extra}


def test_differences_beyond_noise_are_distinguished_from_others() -> None:
    ess = np.full(10, 100.0)
    error = np.sqrt(10 * (1 / 100 - 1 / PARTICLES))
    others = {
        "near": result(np.full(10, -1.03), ess, filter="particle"),
        "far": result(np.full(10, -2.0), ess, filter="particle"),
    }
    tree = compare(runs(**others))
    assert evidence_words(tree["evidence"].dataset.isel(run=0)) == f"-10.0 ± {error:.2g}"
    assert tree["evidence/beyond_noise"].values.tolist() == [[False, False, True], [False, False, True], [True, True, False]]
    texts = [found.text for found in findings(tree)]
    assert f"Log evidence: good -10.0 ± {error:.2g}; near -10.3 ± {error:.2g}; far -20.0 ± {error:.2g}." in texts
    assert "The log evidence of good is the largest, significantly above far, not significantly above near." in texts


def test_seeds_tell_the_error_of_what_does_not_know_its_own() -> None:
    rng = np.random.default_rng(1)
    seeds = {
        f"seed {seed}": result(
            -1 + 0.1 * rng.standard_normal(10), np.full(10, 9.0), filter="tempered", settings={"n": 1}, seed=seed
        )
        for seed in range(3)
    }
    alone = compare(runs(a=seeds["seed 0"], b=seeds["seed 1"]))
    assert evidence_words(alone["evidence"].dataset.isel(run=1)).endswith("± ?")
    assert any("a and b is unknown" in found.text for found in findings(alone))
    together = compare(seeds)
    totals = together["evidence/log_evidence"].values
    np.testing.assert_allclose(together["evidence/standard_error"], totals.std(ddof=1))
    assert not any("not known" in found.text for found in findings(together))


@pytest.mark.full
def test_seekers_of_modes_have_none() -> None:
    tree = compare(runs(seeker=result(np.full(10, -0.5), np.full(10, 9.0), filter="annealed")))
    assert evidence_words(tree["evidence"].dataset.isel(run=1)) == "–"
    assert any(found.text.startswith("No evidence from seeker") for found in findings(tree))
