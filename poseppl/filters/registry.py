"""The filters by name, with the settings that each takes: what the command line offers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import signature
from typing import Any, NamedTuple

from poseppl.errors import InputError
from poseppl.filters.annealed import annealed_filter
from poseppl.filters.assumed_density import TRACKER, assumed_density_filter
from poseppl.filters.base import Filter
from poseppl.filters.demc import demc_filter
from poseppl.filters.guided import guided_filter
from poseppl.filters.hmc import hmc_filter
from poseppl.filters.kalman import kalman_filter
from poseppl.filters.particle import particle_filter
from poseppl.filters.tempered import tempered_filter
from poseppl.filters.window import window_filter
from poseppl.gaussians.linearisation import Method
from poseppl.kernels.hmc import HMCSettings
from poseppl.program import CompiledModel

Settings = Mapping[str, Any]


class FilterEntry(NamedTuple):
    """A filter that can be chosen by its name.

    Attributes:
        build: `(model, settings) -> filter`; the settings are all there.
        defaults: The settings that it takes, with their defaults.
        summary: What it is, in a sentence.
        genealogy: Whether its particles descend from those of the frame before.
    """

    build: Callable[[CompiledModel, Settings], Filter]
    defaults: Settings
    summary: str
    genealogy: bool = False


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


def _window(model: CompiledModel, settings: Settings) -> Filter:
    return window_filter(
        model,
        settings["chains"],
        _chain_settings(settings),
        window=settings["window"],
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


def _guided(auxiliary: bool) -> Callable[[CompiledModel, Settings], Filter]:
    def build(model: CompiledModel, settings: Settings) -> Filter:
        return guided_filter(
            model,
            settings["particles"],
            auxiliary=auxiliary,
            resampling=settings["resampling"],
            ess_threshold=settings["ess_threshold"],
        )

    return build


def _kalman(linearisation: Method) -> Callable[[CompiledModel, Settings], Filter]:
    return lambda model, settings: kalman_filter(model, settings["particles"], linearisation=linearisation)


def _tempered(model: CompiledModel, settings: Settings) -> Filter:
    names = ("target", "ess_target", "chain_length", "resampling")
    return tempered_filter(model, settings["particles"], **{name: settings[name] for name in names})


def _annealed(model: CompiledModel, settings: Settings) -> Filter:
    return annealed_filter(
        model,
        settings["particles"],
        num_layers=settings["layers"],
        survival=settings["survival"],
        resampling=settings["resampling"],
    )


def _demc(model: CompiledModel, settings: Settings) -> Filter:
    return demc_filter(model, settings["particles"], num_layers=settings["layers"], resampling=settings["resampling"])


_PARTICLES = {"particles": 2000, "resampling": "systematic", "ess_threshold": 1.0}

FILTERS: Mapping[str, FilterEntry] = {
    "assumed-density": FilterEntry(
        _assumed_density,
        {
            **_chain_defaults(assumed_density_filter, TRACKER),
            "components": _default(assumed_density_filter, "num_components"),
            "starts": _default(assumed_density_filter, "num_starts"),
        },
        "HMC with a few Gaussians, fitted to all draws, for the past: near-honest intervals.",
    ),
    "window": FilterEntry(
        _window,
        {
            **_chain_defaults(window_filter, TRACKER),
            "window": _default(window_filter, "window"),
            "starts": _default(window_filter, "num_starts"),
        },
        "HMC on the last few frames together, the older past summarised by a Gaussian: slower, and less is summarised.",
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
        genealogy=True,
    ),
    "guided": FilterEntry(
        _guided(auxiliary=False),
        _PARTICLES,
        "Particles drawn from a local linearisation that has seen the frame.",
        genealogy=True,
    ),
    "auxiliary": FilterEntry(
        _guided(auxiliary=True),
        _PARTICLES,
        "The guided filter, which also chooses ancestors by what the frame says of them.",
        genealogy=True,
    ),
    "tempered": FilterEntry(
        _tempered,
        {
            "particles": 500,
            "target": _default(tempered_filter, "target"),
            "ess_target": _default(tempered_filter, "ess_target"),
            "chain_length": _default(tempered_filter, "chain_length"),
            "resampling": "systematic",
        },
        "Particles cooled from the prediction to the posterior by tempered SMC with HMC moves.",
        genealogy=True,
    ),
    "annealed": FilterEntry(
        _annealed,
        {
            "particles": 1000,
            "layers": _default(annealed_filter, "num_layers"),
            "survival": _default(annealed_filter, "survival"),
            "resampling": _default(annealed_filter, "resampling"),
        },
        "The annealed particle filter: seeks a mode, and is no posterior.",
        genealogy=True,
    ),
    "de-mc": FilterEntry(
        _demc,
        {"particles": 1000, "layers": _default(demc_filter, "num_layers"), "resampling": "systematic"},
        "The particle filter of Du and Guan 2006, moved by differential evolution: seeks a mode.",
        genealogy=True,
    ),
    "extended-kalman": FilterEntry(_kalman("first-order"), {"particles": 1000}, "The extended Kalman filter: one Gaussian."),
    "unscented-kalman": FilterEntry(_kalman("unscented"), {"particles": 1000}, "The unscented Kalman filter: one Gaussian."),
}

LEAST = {
    "layers": 1,
    "chain_length": 1,
    "chains": 1,
    "draws": 1,
    "leapfrog": 1,
    "burn_in": 0,
    "particles": 1,
    "components": 1,
    "starts": 1,
    "window": 1,
}
MOST = {"chains": 100_000, "draws": 1_000_000, "leapfrog": 100_000, "burn_in": 1_000_000, "particles": 2**24 - 1}


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
    for name in ("survival", "ess_target"):
        if name in settings and not 0 < settings[name] < 1:
            raise InputError(f"{settings[name]:g}", field=option(name), expected="between 0 and 1")
    if "ess_threshold" in settings and not 0 <= settings["ess_threshold"] <= 1:
        raise InputError(f"{settings['ess_threshold']:g}", field="--ess-threshold", expected="0 to 1")
