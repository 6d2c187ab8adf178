"""Checks of settings: what each refuses, to the ends of its range, and that the message names the setting."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from poseppl.checks import RangeError, check_at_least, check_choice, check_fraction


def test_numbers_that_are_too_small_are_refused():
    check_at_least(1, num_chains=1, num_draws=7, inflation=1.0)
    with pytest.raises(RangeError, match=r"num_draws is 0\. Expected at least 1\.") as caught:
        check_at_least(1, num_chains=1, num_draws=0)
    assert (caught.value.setting, caught.value.value, caught.value.expected) == ("num_draws", 0, "at least 1")


@pytest.mark.parametrize("value", ["100", 1e3, 1.5, None])
def test_counts_are_whole_numbers(value):
    check_at_least(1, num_draws=np.int64(7), max_draws=True)
    with pytest.raises(RangeError, match=rf"num_draws is {value!r}\. Expected a whole number, at least 1\."):
        check_at_least(1, num_draws=value)
    with pytest.raises(RangeError, match=r"chunk is '8'\. Expected at least 1\."):
        check_at_least(1, chunk="8")


@pytest.mark.full
@pytest.mark.parametrize(("interval", "refused"), [("[0, 1]", ()), ("[0, 1)", (1,)), ("(0, 1)", (0, 1))])
def test_fractions_are_refused_outside_their_interval(interval, refused):
    for value in (0, 0.5, 1):
        if value not in refused:
            check_fraction(interval, jitter=value)
    for value in (*refused, -0.1, 1.1, float("nan")):
        with pytest.raises(ValueError, match=f"jitter is {value}"):
            check_fraction(interval, jitter=value)


@pytest.mark.full
def test_words_are_refused_that_a_literal_does_not_name():
    check_choice(Literal["exact", "linear"], method="linear")
    with pytest.raises(ValueError, match=r"method is 'quick'\. Expected one of exact, linear\."):
        check_choice(Literal["exact", "linear"], method="quick")
