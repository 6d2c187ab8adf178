"""Data at the host boundary: values of the observation's sites, with an explicit mask for what is missing.

Outside, NaN means missing. Inside there is no NaN: a masked entry has a value within the support, so that densities and
gradients of masked entries are finite before they are multiplied by zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import Array
from numpyro.distributions import constraints

from poseppl.errors import InputError
from poseppl.program.execution import base_support
from poseppl.program.explanation import suggestion
from poseppl.program.schema import Declared


class Observation(NamedTuple):
    """Data of one frame, or of a sequence with a leading time axis.

    Attributes:
        values: Value of each observation site, finite everywhere.
        mask: Boolean of the same shape for each site; True means observed.
    """

    values: dict[str, Array]
    mask: dict[str, Array]


def check_is_observation(data: Any) -> None:
    """Refuse data that did not go through `observe`.

    Raises:
        ValueError: They are something else than an Observation.
    """
    if not isinstance(data, Observation):
        raise ValueError(
            f"The data are a {type(data).__name__}. Expected an Observation, which marks missing data: "
            "model.observe({site: values}), with NaN where nothing was seen."
        )


def check_frame_shapes(sites: Mapping[str, Declared], data: Observation, num_frames: int | None = None) -> None:
    """Compare the shapes of data with those of the model's sites, which would broadcast in silence.

    Args:
        sites: The observation sites of the model.
        data: One frame, or a sequence of `num_frames`.
        num_frames: T; None for one frame.

    Raises:
        ValueError: Another site, or another shape.
    """
    leading = () if num_frames is None else (num_frames,)
    wanted = {name: (*leading, *site.shape) for name, site in sites.items()}
    given = {name: np.shape(values) for name, values in data.values.items()}
    if given != wanted:
        frames = "one frame" if num_frames is None else f"{num_frames} frames"
        raise ValueError(f"The data have the shapes {given}. Expected those of {frames} of the model's sites: {wanted}.")


def num_frames_of(sites: Mapping[str, Declared], data: Observation) -> int:
    """T of a sequence of data.

    Raises:
        InputError: The data are those of no frame, or of one.
        ValueError: They are no Observation, or have another site or shape.
    """
    check_is_observation(data)
    if not sites:
        raise InputError("the model has no data sites, whose rows are frames", expected="numpyro.sample in its observation")
    site, declared = next(iter(sites.items()))
    values = data.values.get(site)
    if values is None or np.ndim(values) != len(declared.shape) + 1 or not len(values):
        expected = f"shape {('T', *declared.shape)}, T at least 1".replace("'", "")
        raise InputError("the data are not those of a sequence", field=site, expected=expected)
    check_frame_shapes(sites, data, len(values))
    return len(values)


def observe(
    sites: Mapping[str, Declared],
    values: Mapping[str, Any],
    mask: Mapping[str, Any] | None = None,
    frames: int | None = None,
) -> Observation:
    """Turn arrays with NaN into an Observation.

    Args:
        sites: The observation sites of the model.
        values: One array per site, of the site's shape, or with a leading time axis T; NaN where missing.
        mask: Booleans of the same shapes, True where observed; sites left out take the mask from NaN.
        frames: The expected T; None accepts one frame or any T.

    Raises:
        ValueError: An unknown or missing site, a value that is not a number, a wrong shape, an infinite value, or a NaN that
            the mask marks as observed. Also an integer outside the site's support, or an event that is observed in part.
    """
    if not hasattr(values, "keys"):
        raise ValueError(f"The data are a {type(values).__name__}. Expected a dict of arrays by site, {list(sites)}.")
    for given, what in ((values, "values"), (mask or {}, "mask")):
        for name in given:
            if name not in sites:
                hint = suggestion(name, sites)
                raise ValueError(f"{what} has {name!r}, which is no observation site{hint}. Expected {list(sites)}.")
    lengths: dict[str, int | None] = {}
    kept, masks = {}, {}
    for name, site in sites.items():
        if name not in values:
            raise ValueError(f"values lacks the observation site {name!r}. Pass an array, with NaN where nothing was seen.")
        array = number_array(name, values[name])
        lengths[name] = _length(name, site, array, frames)
        given_mask = None if mask is None or name not in mask else np.asarray(mask[name])
        kept[name], masks[name] = _observe_site(name, site, array, given_mask)
    if len(set(lengths.values())) > 1:
        raise ValueError(f"Observation sites differ in their number of frames: {lengths}. Expected one T for all.")
    return Observation(*jax.device_put((kept, masks)))  # at once; compiles nothing, as jnp.asarray does


def number_array(name: str, given: Any) -> np.ndarray[Any, Any]:
    """The data as an array of numbers, NaN for entries that a masked array hides or that are None."""
    hidden: Any = given if isinstance(given, np.ma.MaskedArray) else None
    try:
        array = np.asarray(given if hidden is None else hidden.astype(float).filled(np.nan))
        if array.dtype.kind in "OSU":
            array = array.astype(float)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"Observation site {name!r} cannot be made an array of numbers: {error}. Expected numbers of one shape in every "
            "frame, with NaN where nothing was seen."
        ) from error
    if array.dtype.kind in "cmM":
        raise ValueError(
            f"Observation site {name!r} is of the type {array.dtype}. Expected numbers, with NaN where nothing was seen."
        )
    return array


def _length(name: str, site: Declared, array: np.ndarray[Any, Any], frames: int | None) -> int | None:
    """T of a stacked sequence, None for one frame."""
    if array.shape == site.shape and frames is None:
        return None
    if array.shape[1:] == site.shape and array.ndim == len(site.shape) + 1 and frames in (None, array.shape[0]):
        return int(array.shape[0])
    time = "T" if frames is None else str(frames)
    stacked = "(" + ", ".join([time, *map(str, site.shape)]) + ("," if not site.shape else "") + ")"
    one_frame = f"{site.shape} for one frame, or " if frames is None else ""
    raise ValueError(f"Observation site {name!r} has shape {array.shape}. Expected {one_frame}{stacked} for a sequence.")


def _observe_site(
    name: str, site: Declared, array: np.ndarray[Any, Any], mask: np.ndarray[Any, Any] | None
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    is_nan = np.isnan(array) if array.dtype.kind == "f" else np.zeros(array.shape, bool)
    if mask is None:
        mask = ~is_nan
    elif mask.shape != array.shape or mask.dtype.kind != "b":
        found = f"{mask.dtype} of shape {mask.shape}"
        raise ValueError(f"The mask of {name!r} is {found}. Expected bool of the shape of its values, {array.shape}.")
    elif np.any(is_nan & mask):
        index = tuple(int(i) for i in np.argwhere(is_nan & mask)[0])
        raise ValueError(f"Observation {name!r} is NaN at {index}, which its mask calls observed. Mask it, or leave out mask.")
    if array.dtype.kind == "f" and np.any(np.isinf(array) & mask):
        index = tuple(int(i) for i in np.argwhere(np.isinf(array) & mask)[0])
        raise ValueError(f"Observation {name!r} is infinite at {index}. Expected finite values, NaN where missing.")
    event = tuple(range(mask.ndim - site.event_dim, mask.ndim))
    if not site.divisible and np.any(mask.any(event) != mask.all(event)):
        raise ValueError(
            f"Observation {name!r} has an event that is observed in part. Its distribution has {site.event_dim} event "
            "dimension(s), which are seen or missing together: make them batch dimensions (no to_event, independent Normal) "
            "to mask single entries."
        )
    fill = feasible(site)
    safe = np.where(mask, array, np.broadcast_to(fill, array.shape))
    with np.errstate(invalid="ignore"):
        kept = safe.astype(site.dtype)
    if site.kind != "float" and np.any(safe != kept):
        what = "no integers" if np.any(safe != np.round(safe)) else f"too large for {site.dtype}"
        raise ValueError(f"Observation {name!r} has values that are {what}. Expected {site.dtype}, NaN where missing.")
    _check_support(name, site, kept)
    return kept, np.array(mask)


def feasible(site: Declared) -> np.ndarray[Any, Any]:
    """A value of the site's shape inside its support (0 where the support is known only at run time)."""
    prototype = np.zeros(site.shape, site.dtype)
    if site.support is None or base_support(site.support) is constraints.real:
        return prototype
    try:
        with jax.ensure_compile_time_eval():
            return np.asarray(site.support.feasible_like(prototype)).astype(site.dtype)
    except NotImplementedError:
        return prototype


def _check_support(name: str, site: Declared, values: np.ndarray[Any, Any]) -> None:
    """Refuse integers outside the support, which would silently index the nearest entry of a table."""
    if site.support is None or site.kind == "float":
        return
    with jax.ensure_compile_time_eval():
        inside = np.asarray(base_support(site.support)(values))
    if not inside.all():
        raise ValueError(
            f"Observation {name!r} has values outside the support {site.support} of its distribution. "
            "Correct the data, or mask the wrong entries."
        )
