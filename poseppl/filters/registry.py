"""The filters by name, with the settings that each takes: what the command line offers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import signature
from typing import Any, NamedTuple

from poseppl.errors import InputError
from poseppl.filters.assumed_density import TRACKER, assumed_density_filter
from poseppl.filters.base import Filter
from poseppl.filters.hmc import hmc_filter
from poseppl.filters.particle import particle_filter
from poseppl.kernels.hmc import HMCSettings
from poseppl.program import CompiledModel

Settings = Mapping[str, Any]


class FilterEntry(NamedTuple):
    """A filter that can be chosen by its name.

    Attributes:
        build: `(model, settings) -> filter`; the settings are all there.
        defaults: The settings that it takes, with their defaults.
        summary: What it is, in a sentence.
    """

    build: Callable[[CompiledModel, Settings], Filter]
    defaults: Settings
    summary: str


def _chain_defaults(filter: Callable[..., Filter], settings: HMCSettings) -> dict[str, Any]:
    return {
        "chains": _default(filter, "num_chains"),
        "draws": settings.num_updates,
        "leapfrog": settings.num_leapfrog,
        "burn_in": settings.burn_in,
        "step_size": settings.step_size,
        "rejection": settings.target_rejection,
        "jitter": settings.jitter,
    }


def _default(filter: Callable[..., Filter], argument: str) -> Any:
    return signature(filter).parameters[argument].default


def _chain_settings(settings: Settings) -> HMCSettings:
    return HMCSettings(
        num_updates=settings["draws"],
        num_leapfrog=settings["leapfrog"],
        burn_in=settings["burn_in"],
        step_size=settings["step_size"],
        target_rejection=settings["rejection"] or None,
        jitter=settings["jitter"],
    )


def _assumed_density(model: CompiledModel, settings: Settings) -> Filter:
    return assumed_density_filter(
        model,
        settings["chains"],
        _chain_settings(settings),
        num_components=settings["components"],
        num_starts=settings["starts"],
    )


def _hmc(model: CompiledModel, settings: Settings) -> Filter:
    return hmc_filter(
        model,
        settings["chains"],
        _chain_settings(settings),
        dense_mass=settings["dense_mass"],
        resampling=settings["resampling"],
    )


def _particle(model: CompiledModel, settings: Settings) -> Filter:
    return particle_filter(
        model, settings["particles"], resampling=settings["resampling"], ess_threshold=settings["ess_threshold"]
    )


FILTERS: Mapping[str, FilterEntry] = {
    "assumed-density": FilterEntry(
        _assumed_density,
        {
            **_chain_defaults(assumed_density_filter, TRACKER),
            "components": _default(assumed_density_filter, "num_components"),
            "starts": _default(assumed_density_filter, "num_starts"),
        },
        "HMC with a Gaussian temporal prior fitted to all draws: intervals that hold what they say.",
    ),
    "hmc": FilterEntry(
        _hmc,
        {**_chain_defaults(hmc_filter, HMCSettings()), "dense_mass": False, "resampling": "systematic"},
        "The HMC filter of Choo and Fleet 2001: the temporal prior is a mixture over the last state of every chain.",
    ),
    "particle": FilterEntry(
        _particle,
        {"particles": 10_000, "resampling": "systematic", "ess_threshold": 1.0},
        "The particle filter with the temporal prior as proposal.",
    ),
}

LEAST = {"chains": 1, "draws": 1, "leapfrog": 1, "burn_in": 0, "particles": 1, "components": 1, "starts": 1}
MOST = {"chains": 100_000, "draws": 1_000_000, "leapfrog": 100_000, "burn_in": 1_000_000, "particles": 100_000_000}


def build_filter(name: str, model: CompiledModel, settings: Settings) -> tuple[Filter, dict[str, Any]]:
    """Build a filter by its name.

    Args:
        name: A key of :data:`FILTERS`.
        model: The compiled model.
        settings: Settings that differ from the defaults; None stands for the default.

    Returns:
        The filter and all its settings.

    Raises:
        InputError: An unknown filter, a setting that it does not take, or one out of range; the message names the option.
    """
    whole = check_settings(name, settings)
    try:
        return FILTERS[name].build(model, whole), whole
    except ValueError as error:
        raise InputError(str(error), field="--filter") from error


def check_settings(name: str, settings: Settings) -> dict[str, Any]:
    """Fill in a filter's defaults; arguments and errors as in :func:`build_filter`."""
    if name not in FILTERS:
        raise InputError(f"{name!r} is no filter", field="--filter", expected=", ".join(FILTERS))
    defaults = FILTERS[name].defaults
    given = {key: value for key, value in settings.items() if value is not None}
    for key in given:
        if key not in defaults:
            takes = ", ".join(map(option, defaults))
            raise InputError(f"the filter {name!r} has no such setting", field=option(key), expected=takes)
    whole = {**defaults, **given}
    _check(whole)
    return whole


def option(name: str) -> str:
    """The command-line option of a setting."""
    return "--" + name.replace("_", "-")


def _check(settings: Settings) -> None:
    for name, least in LEAST.items():
        if name in settings and not least <= settings[name] <= MOST.get(name, 1000):
            expected = f"{least} to {MOST.get(name, 1000)}"
            raise InputError(f"{settings[name]}", field=option(name), expected=expected)
    if "burn_in" in settings and settings["burn_in"] >= settings["draws"]:
        raise InputError(f"{settings['burn_in']}", field="--burn-in", expected=f"less than --draws, {settings['draws']}")
    if "step_size" in settings and not 0 < settings["step_size"] < 1e3:
        raise InputError(f"{settings['step_size']:g}", field="--step-size", expected="a positive number")
    if "rejection" in settings and not 0 <= (settings["rejection"] or 0.0) < 1:
        raise InputError(f"{settings['rejection']:g}", field="--rejection", expected="0 (fixed step size) to below 1")
    if "jitter" in settings and not 0 <= settings["jitter"] < 1:
        raise InputError(f"{settings['jitter']:g}", field="--jitter", expected="0 to below 1")
    if "ess_threshold" in settings and not 0 <= settings["ess_threshold"] <= 1:
        raise InputError(f"{settings['ess_threshold']:g}", field="--ess-threshold", expected="0 to 1")
