"""Numbers of one call of the generator have the laws that are asked for, and choices their weights."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from poseppl.particles.keys import normals_and_uniforms, weighted_choice

pytestmark = pytest.mark.full


@pytest.mark.parametrize("wide", [False, True])
def test_normals_and_uniforms_have_their_laws(wide):
    with jax.enable_x64(wide):
        dtype = jnp.result_type(float)
        normals, uniforms = map(np.asarray, normals_and_uniforms(jax.random.key(0), (50, 400), 2, 1, dtype))
    assert normals.dtype == uniforms.dtype == dtype
    assert normals.shape == (50, 400, 2) and uniforms.shape == (50, 400, 1)
    columns = [np.ravel(normals[..., 0]), np.ravel(normals[..., 1]), stats.norm.ppf(np.ravel(uniforms) * (1 - 1e-7) + 5e-8)]
    for column in columns:
        assert stats.kstest(column, "norm").pvalue > 1e-3
    np.testing.assert_allclose(np.corrcoef(columns), np.eye(3), atol=5 / np.sqrt(50 * 400))
    assert float(uniforms.min()) >= 0.0 and float(uniforms.max()) < 1.0
    assert stats.kstest(columns[0], stats.norm(0, 1.05).cdf).pvalue < 1e-3


def test_choices_follow_their_weights():
    log_weights = jnp.log(jnp.array([0.0, 0.5, 0.0, 0.2, 0.3, 0.0])) + 3.0
    number = 40_000
    chosen = np.asarray(weighted_choice((jnp.arange(number) + 0.5) / number, log_weights))
    np.testing.assert_allclose(np.bincount(chosen, minlength=6) / number, [0.0, 0.5, 0.0, 0.2, 0.3, 0.0], atol=1e-4)
    rows = weighted_choice(jnp.array([0.0, 0.999999]), jnp.stack([log_weights, log_weights]))
    assert rows.tolist() == [1, 4]


def test_without_weights_the_first_is_chosen():
    assert int(weighted_choice(jnp.array(0.5), jnp.full(3, -jnp.inf))) == 0
