"""A result's filter, run again for all its particles and their ancestors, of which the result keeps a thinning and none.

The result tells the filter, its settings and its seed, so the particles are those of the first run; on another machine or with
another version of JAX they are others of the same law.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import xarray as xr

from poseppl.errors import Argument, InputError, Phrase, SettingError, brief
from poseppl.motion.tracking.problem import Problem
from poseppl.runs.algorithms import FILTERS, Algorithm
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
    name, seed = str(known.get("filter")), known.get("seed")
    filter, settings = FILTERS[name].build(problem.model, _recorded(FILTERS[name], known.get("settings")))
    if not filter.genealogy:
        raise InputError(
            f"the result of the filter {brief(name)} has no genealogy, which this smoother follows",
            field=Argument("method"),
            expected="a result of the filter particle, or another smoother, such as trajectory",
        )
    if not isinstance(seed, int):
        raise InputError("the result does not state the filter's seed", expected="a result of poseppl track of this version")
    num_frames = tree["posterior"].sizes["frame"]
    if num_frames * settings["num_particles"] * (problem.model.dimension + 2) > _MAX_VALUES:
        raise InputError(
            f"the genealogy of {settings['num_particles']:,} particles over {num_frames} frames would take more than 4 GiB",
            field=Argument("method"),
            expected=Phrase(
                "a result of fewer particles or frames, or ",
                Argument("method", "forward-backward"),
                ", which uses the stored draws",
            ),
        )
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


def _recorded(filter: Algorithm, settings: Any) -> dict[str, Any]:
    """The filter's settings as the result tells them, all of them."""
    given = settings if isinstance(settings, Mapping) else {}
    for name, setting in filter.settings.items():
        try:
            setting.read(given[name])
        except (KeyError, SettingError) as error:
            message = f"the result does not state the filter's setting {brief(name)}"
            raise InputError(message, expected="a result of poseppl track of this version") from error
    return {name: given[name] for name in filter.settings}
