"""A fingerprint of a model, by which a result refuses to be taken on under other params.

It covers the names of the coordinates and the numbers among the params, not the programs' code. Numbers count in single
precision, so that a result of a file fits the model in either precision.
"""

from __future__ import annotations

import hashlib
from typing import Any

import jax
import numpy as np
import xarray as xr

from poseppl.program import CompiledModel
from poseppl.runs.contents import check_coordinates
from poseppl.runs.results import provenance

FINGERPRINT = "model fingerprint"
"""The attribute of a result."""


def fingerprint_of(model: CompiledModel) -> dict[str, str]:
    """The attribute that recognises a model; none while its params are unset or traced.

    Args:
        model: The model.
    """
    leaves = jax.tree_util.tree_leaves_with_path(model.params)
    if model.unbound or any(isinstance(leaf, jax.core.Tracer) for _, leaf in leaves):
        return {}
    digest = hashlib.sha256(repr(model.coordinate_names).encode())
    for path, leaf in leaves:
        digest.update(jax.tree_util.keystr(path).encode())
        digest.update(_bytes(leaf))
    return {FINGERPRINT: digest.hexdigest()[:16]}


def check_same_model(tree: xr.DataTree, model: CompiledModel) -> None:
    """Refuse a result that a model of other coordinates or params gave; one without a fingerprint is accepted.

    Raises:
        ValueError: It is one.
    """
    check_coordinates(tree, model)
    known, own = provenance(tree).get(FINGERPRINT), fingerprint_of(model).get(FINGERPRINT)
    if known is not None and own is not None and known != own:
        raise ValueError(
            "The result was filtered under other params than the model has. Use the model that it was filtered under."
        )


def _bytes(leaf: Any) -> bytes:
    """A number or an array of them; nothing of what is neither."""
    try:
        array = np.asarray(leaf)
    except TypeError:  # such as typed keys
        return b""
    if array.dtype.kind not in "fiub":
        return b""
    return repr(array.shape).encode() + array.astype(np.float32).tobytes()
