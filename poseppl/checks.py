"""Checks of numbers that a caller sets: each raises ``ValueError`` that names the setting, its value and what was expected.

>>> check_at_least(1, num_particles=0)
Traceback (most recent call last):
ValueError: num_particles is 0. Expected at least 1.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

Interval = Literal["[0, 1]", "[0, 1)", "(0, 1]", "(0, 1)"]


def check_at_least(least: float, **settings: float) -> None:
    """Refuse settings below a number.

    Args:
        least: The smallest number that is accepted.
        **settings: Values by name.

    Raises:
        ValueError: A value is smaller.
    """
    for name, value in settings.items():
        if value < least:
            raise ValueError(f"{name} is {value}. Expected at least {least}.")


def check_choice(choices: Any, **settings: Any) -> None:
    """Refuse settings that are none of the values of a ``Literal``.

    Args:
        choices: The type, such as ``Literal["exact", "linear"]``.
        **settings: Values by name.

    Raises:
        ValueError: A value is none of them.
    """
    for name, value in settings.items():
        if value not in get_args(choices):
            raise ValueError(f"{name} is {value!r}. Expected one of {', '.join(get_args(choices))}.")


def check_fraction(interval: Interval, **settings: float) -> None:
    """Refuse settings that are no fraction.

    Args:
        interval: What is accepted; a round bracket leaves its end out.
        **settings: Values by name.

    Raises:
        ValueError: A value lies outside, or is NaN.
    """
    for name, value in settings.items():
        above = value >= 0 if interval[0] == "[" else value > 0
        below = value <= 1 if interval[-1] == "]" else value < 1
        if not (above and below):
            raise ValueError(f"{name} is {value}. Expected a number in {interval}.")
