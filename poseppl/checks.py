"""Checks of numbers that a caller sets: each raises an error that names the setting, its value and what was expected.

>>> check_at_least(1, num_particles=0)
Traceback (most recent call last):
poseppl.checks.RangeError: num_particles is 0. Expected at least 1.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

from poseppl.errors import brief, cut

_COUNTS = ("num_", "max_", "horizon")
"""The prefix of names of counts."""
Interval = Literal["[0, 1]", "[0, 1)", "(0, 1]", "(0, 1)"]


class RangeError(ValueError):
    """A setting out of its range.

    Attributes:
        setting: Its name, that of an argument.
        value: Its value.
        expected: The expected values, in words.
    """

    def __init__(self, setting: str, value: Any, expected: str) -> None:
        super().__init__(f"{setting} is {brief(value) if isinstance(value, str | int) else cut(value)}. Expected {expected}.")
        self.setting, self.value, self.expected = setting, value, expected


def check_at_least(least: float, **settings: float) -> None:
    """Refuse settings below a number, and counts (``num_...``, ``max_...``) that are no whole numbers.

    Args:
        least: The smallest number that is accepted.
        **settings: Values by name.

    Raises:
        RangeError: A value is smaller, or no number of its kind.
    """
    for name, value in settings.items():
        if name.startswith(_COUNTS) and not hasattr(value, "__index__"):
            raise RangeError(name, value, f"a whole number, at least {least}")
        if isinstance(value, str) or value < least:
            raise RangeError(name, value, f"at least {least}")


def check_key(rng_key: Any) -> None:
    """Refuse what is no PRNG key, such as a seed.

    Raises:
        RangeError: It is a number, or None.
    """
    if not str(getattr(rng_key, "dtype", "")).startswith("key") and not getattr(rng_key, "ndim", 0):
        raise RangeError("rng_key", rng_key, "a key, such as jax.random.key(0)")


def check_choice(choices: Any, **settings: Any) -> None:
    """Refuse settings that are none of the values of a ``Literal``.

    Args:
        choices: The type, such as ``Literal["exact", "linear"]``.
        **settings: Values by name.

    Raises:
        RangeError: A value is none of them.
    """
    for name, value in settings.items():
        if value not in get_args(choices):
            raise RangeError(name, value, f"one of {', '.join(get_args(choices))}")


def check_fraction(interval: Interval, **settings: float) -> None:
    """Refuse settings that are no fraction.

    Args:
        interval: The accepted values; a round bracket leaves its end out.
        **settings: Values by name.

    Raises:
        RangeError: A value lies outside, or is NaN.
    """
    for name, value in settings.items():
        above = value >= 0 if interval[0] == "[" else value > 0
        below = value <= 1 if interval[-1] == "]" else value < 1
        if not (above and below):
            raise RangeError(name, value, f"a number in {interval}")
