"""What this experiment takes of ``poseppl_models``, which is found when it runs."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def shipped(place: str) -> Any:
    """What a module of ``poseppl_models`` has under a name.

    Args:
        place: Such as "sminchisescu_body:superquadric_body".
    """
    module, _, name = place.partition(":")
    return getattr(import_module(f"poseppl_models.{module}"), name)
