"""Closed forms of distributions against their own log_prob, loc and scale."""

import jax.numpy as jnp
import numpyro.distributions as dist
import pytest

from poseppl.program import SummedDensity, WhitenedJacobian, check_closed_forms

STATE, VALUE = jnp.array([0.3, -0.8]), jnp.array([0.1, 0.2, -1.0, 2.0])
ROWS = jnp.array([[1.0, 0.0], [0.0, 2.0], [1.0, 1.0], [-1.0, 0.5]])


class Plane(dist.Normal):
    """Four heights on a plane."""

    def __init__(self, state, slope=1.0):
        self.state, self.fixed, self.slope = state, ROWS, slope
        super().__init__(ROWS @ state, 0.5)

    def whitened_jacobian(self, mask):
        rows = self.slope * ROWS / 0.5
        return rows if mask is None else jnp.where(mask[:, None], rows, 0.0)


class Summed(dist.Normal):
    """Four heights that are summed at once."""

    def __init__(self, state, masked=True):
        self.masked = masked
        super().__init__(ROWS @ state, 0.5)

    def summed_log_prob(self, value, mask):
        kept = jnp.ones(value.shape) if mask is None or not self.masked else mask
        return jnp.sum(kept * dist.Normal(self.loc, 0.5).log_prob(value))


def test_the_protocols_are_found_by_their_methods():
    assert isinstance(Plane(STATE), WhitenedJacobian) and not isinstance(Plane(STATE), SummedDensity)
    assert isinstance(Summed(STATE), SummedDensity) and not isinstance(Summed(STATE), WhitenedJacobian)
    assert not isinstance(dist.Normal(0.0, 1.0), SummedDensity | WhitenedJacobian)


@pytest.mark.full
def test_right_ones_pass():
    check_closed_forms(Plane, STATE, VALUE)
    check_closed_forms(Summed, STATE, VALUE)


@pytest.mark.full
@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda x: Plane(x, slope=1.01), r"whitened_jacobian\(None\) differs by 0.04"),
        (lambda x: Summed(x, masked=False), r"summed_log_prob\(value, mask\) differs"),
        (lambda x: dist.Normal(ROWS @ x, 0.5), "neither summed_log_prob nor whitened_jacobian"),
    ],
)
def test_wrong_ones_are_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        check_closed_forms(wrong, STATE, VALUE)
