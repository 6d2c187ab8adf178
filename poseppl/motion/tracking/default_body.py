"""The body that is tracked where nobody names one: with feet where these are seen."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from poseppl_models.bodies.choo_fleet import full_body
from poseppl_models.bodies.footed import FOOT_MARKERS, footed_body

from poseppl.motion.bodies.body import name_of_builder

DEFAULT_MODEL = name_of_builder(full_body)
FOOTED_MODEL = name_of_builder(footed_body)


def model_of_points(markers: Collection[str]) -> str:
    """The builder of the body for points of a detector, by the names of the markers that they are of."""
    return FOOTED_MODEL if set(FOOT_MARKERS) <= set(markers) else DEFAULT_MODEL


def chosen_model(asked: str | None, provenance: Mapping[str, Any]) -> str:
    """The builder of a scene's body: the one that is asked for, or the one that the scene's points led to."""
    return asked or str(provenance.get("model", DEFAULT_MODEL))
