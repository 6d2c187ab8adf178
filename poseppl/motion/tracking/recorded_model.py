"""The model that a result was made with.

A result is a file, perhaps somebody else's: what it says of its model is checked, and it chooses among installed bodies alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from poseppl_models import BODIES

from poseppl.errors import Argument, InputError, Location, Phrase, brief
from poseppl.motion.bodies.body import Body, body_builder, entry_point_builders, source_of_model
from poseppl.motion.geometry import KinematicTree
from poseppl.motion.io.text_parsing import finite_numbers
from poseppl.runs.contents import names_of, variable
from poseppl.runs.results import provenance

_FARTHEST = 10_000.0
"""From a joint to a marker that it carries, mm."""
_ROUNDED = 1e-3
"""Largest difference of a position, mm, because a result's lengths are rounded."""


class RecordedModel(NamedTuple):
    """A model: its ``name``, its ``body`` with the subject's lengths, and the programs' ``params``."""

    name: str
    body: Body
    params: Mapping[str, float]


def recorded_model(tree: xr.DataTree, model: str | None = None) -> RecordedModel:
    """Build the model of a result again.

    Args:
        tree: The result.
        model: The builder, where the caller names it; without it, the builder that the result names has to be installed.

    Raises:
        InputError: The result does not name its model or has impossible numbers, its model is not installed or has
            changed, or the named one is another.
    """
    known = provenance(tree)
    name = known.get("model")
    if not isinstance(name, str):
        raise InputError("the result does not state its model", expected="a result of poseppl track of this version")
    chosen = name if model is None else model
    if model is not None and source_of_model(model) != known.get("model source"):
        raise InputError(f"{model} is not, or no longer, what the result was made with", field=Argument("model"), expected=name)
    builder = installed_builder(name) if model is None else body_builder(model)
    standard = builder(None)
    lengths = finite_numbers(known.get("lengths"), standard.lengths, Location(field="lengths"))
    body = builder({**standard.lengths, **lengths})
    settings = known.get("settings")
    asked = {name: value for name, value in settings.items() if name in body.params} if isinstance(settings, dict) else None
    params = {**body.params, **finite_numbers(asked, body.params, Location(field="settings"))}
    _check_coordinates(tree, body)
    return RecordedModel(chosen, _with_markers(tree, body), params)


def installed_builder(name: str) -> Callable[..., Body]:
    """Resolve the name of a body that is installed as one, and no other; nothing else is imported.

    Installed are the ``BODIES`` of ``poseppl_models`` and the entry points of the group ``poseppl.models``.

    Raises:
        InputError: No such body is installed.
    """
    others = entry_point_builders()
    if name not in (*BODIES, *others, *others.values()):
        problem = f"the result names the model {brief(name)}, which is not installed, so its code is not run"
        expected = Phrase("the model that you used, if it is yours: ", Argument("model", "BUILDER"))
        raise InputError(problem, field=Argument("model"), expected=expected)
    return body_builder(name)


def offsets_per_length(tree: xr.DataTree, model: str | None = None) -> KinematicTree:
    """How the offsets of the body of a result change with each of its lengths, these with a leading axis.

    Args:
        tree: The result.
        model: As of :func:`recorded_model`.

    Raises:
        InputError: As :func:`recorded_model`.
    """
    name, body, _ = recorded_model(tree, model)
    return offsets_of_lengths(body, installed_builder(name) if model is None else body_builder(model))


def offsets_of_lengths(body: Body, build: Callable[..., Body]) -> KinematicTree:
    """How the offsets of a body's tree change with each of its lengths, these with a leading axis; ``build`` is its builder."""
    longer = [build({**body.lengths, length: value + 1.0}).tree for length, value in body.lengths.items()]
    changed: KinematicTree = jax.tree.map(lambda own, *each: jnp.stack(each) - own, build(body.lengths).tree, *longer)
    return changed


def _with_markers(tree: xr.DataTree, body: Body) -> Body:
    """The body with its markers where the result has them."""
    places, own = variable(tree, "inputs", "marker_offsets"), body.tree.marker_offsets
    if places is None or (places.shape == own.shape and np.allclose(places, own, rtol=0.0, atol=_ROUNDED)):
        return body
    if places.shape != own.shape or not np.all(np.abs(places) < _FARTHEST):
        expected = f"{own.shape[0]} places of 3 numbers below {_FARTHEST:g} mm"
        raise InputError("the result has impossible positions of markers", field="inputs/marker_offsets", expected=expected)
    return body._replace(tree=body.tree.with_markers_at(places))


def _check_coordinates(tree: xr.DataTree, body: Body) -> None:
    names = [body.tree.coordinate_names[index] for index in body.free_coordinates]
    if names_of(tree, "state_dim") != names:
        raise InputError(
            "the result is of a body with other coordinates", field=Argument("model"), expected="the body that was tracked"
        )
