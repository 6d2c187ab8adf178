"""A result's filter, run again for all its particles and their ancestors, of which the result keeps a thinning and none.

The result tells the filter, its settings and its seed, so the particles are those of the first run; on another machine or with
another version of JAX they are others of the same law.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import xarray as xr

from poseppl.errors import InputError
from poseppl.filters.registry import FILTERS, build_filter
from poseppl.motion.tracking.problem import Problem
from poseppl.runs.results import provenance
from poseppl.runs.run import run_filter
from poseppl.smoothers.base import History, collect_history

_MAX_VALUES = 2**30
"""Numbers in a history: 4 GiB."""


def filter_again(tree: xr.DataTree, problem: Problem) -> History:
    """Run a result's filter again.

    Args:
        tree: The result.
        problem: The problem that it was made from.

    Returns:
        All particles with their weights and ancestors.

    Raises:
        InputError: The filter keeps no genealogy, the result does not tell its settings, or the particles are too many.
        RunError: The run cannot go on.
    """
    known = provenance(tree)
    name, seed = known.get("filter"), known.get("seed")
    with_genealogy = [entry for entry, filter in FILTERS.items() if filter.genealogy]
    if name not in with_genealogy:
        raise InputError(
            f"the result of the filter {name!r} has no genealogy, which this smoother follows",
            field="--method",
            expected=f"a result of track --filter {' or '.join(with_genealogy)}, or another smoother, such as nuts",
        )
    settings = _recorded(known.get("settings"), FILTERS[name].defaults)
    if not isinstance(seed, int):
        raise InputError("the result does not tell the filter's seed", expected="a result of poseppl track of this version")
    num_frames = tree["posterior"].sizes["frame"]
    if num_frames * settings["particles"] * (problem.model.dimension + 2) > _MAX_VALUES:
        raise InputError(
            f"the genealogy of {settings['particles']:,} particles over {num_frames} frames would take more than 4 GiB",
            field="--method",
            expected="a result of fewer --particles or --frames, or --method forward-backward, which takes the draws kept",
        )
    filter, _ = build_filter(name, problem.model, settings)
    history: History = run_filter(
        filter,
        jax.random.key(seed),
        problem.observations,
        problem.inputs,
        num_frames=num_frames,
        collect=collect_history,
        frame_numbers=tree["posterior"].dataset.coords["frame"].values.tolist(),
    ).outputs
    return history


def _recorded(settings: Any, defaults: Mapping[str, Any]) -> dict[str, Any]:
    """The filter's settings, each a value of its default's kind."""
    given = settings if isinstance(settings, Mapping) else {}
    for name, default in defaults.items():
        if not isinstance(given.get(name), float | int if isinstance(default, float) else type(default)):
            message = f"the result does not tell the filter's setting {name!r}"
            raise InputError(message, expected="a result of poseppl track of this version")
    return {name: given[name] for name in defaults}
