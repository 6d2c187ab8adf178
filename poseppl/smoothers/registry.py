"""The smoothers by name, with the settings that each takes: what the command line offers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import Parameter, signature
from typing import Any, NamedTuple

from poseppl.errors import InputError
from poseppl.program import CompiledModel
from poseppl.smoothers import (
    backward_simulation_smoother,
    fixed_lag_smoother,
    forward_backward_smoother,
    genealogy_smoother,
    gibbs_smoother,
    particle_gibbs_smoother,
    rauch_tung_striebel_smoother,
    trajectory_smoother,
    two_filter_smoother,
    variational_smoother,
    viterbi_smoother,
)
from poseppl.smoothers.base import Smoother


class SmootherEntry(NamedTuple):
    """A smoother that can be chosen by its name.

    Attributes:
        build: `(model, **settings) -> smoother`.
        summary: What it is, in a sentence.
        follows_ancestors: Whether it needs all of the filter's particles and their ancestors, not only draws.
    """

    build: Callable[..., Smoother]
    summary: str
    follows_ancestors: bool = False

    @property
    def defaults(self) -> dict[str, Any]:
        """The settings that are numbers, words or flags, with their defaults."""
        parameters = signature(self.build).parameters.values()
        plain = [p for p in parameters if p.kind is Parameter.KEYWORD_ONLY or p.default is not Parameter.empty]
        return {p.name: p.default for p in plain if isinstance(p.default, bool | int | float | str)}


SMOOTHERS: Mapping[str, SmootherEntry] = {
    "nuts": SmootherEntry(trajectory_smoother, "NUTS on the joint density of all frames, whitened by the model's curvature."),
    "forward-backward": SmootherEntry(
        forward_backward_smoother, "The filter's particles, weighted anew by what comes after them (FBS)."
    ),
    "backward-simulation": SmootherEntry(
        backward_simulation_smoother, "Trajectories drawn backwards through the filter's particles."
    ),
    "two-filter": SmootherEntry(two_filter_smoother, "A filter from either end, combined; new particles at each frame."),
    "viterbi": SmootherEntry(viterbi_smoother, "The most probable path through the filter's particles."),
    "genealogy": SmootherEntry(genealogy_smoother, "The ancestors of the last frame's particles: the baseline.", True),
    "fixed-lag": SmootherEntry(fixed_lag_smoother, "The ancestors of the particles a few frames later.", True),
    "rauch-tung-striebel": SmootherEntry(
        rauch_tung_striebel_smoother, "Gaussian smoothing of a Kalman filter, extended or unscented."
    ),
    "gibbs": SmootherEntry(gibbs_smoother, "Gibbs sampling, the likelihood replaced by a mixture learned from the filter."),
    "variational": SmootherEntry(variational_smoother, "Variational smoothing on the same mixture."),
    "particle-gibbs": SmootherEntry(particle_gibbs_smoother, "Conditional particle filters with ancestor sampling."),
}


def build_smoother(name: str, model: CompiledModel, settings: Mapping[str, str]) -> tuple[Smoother, dict[str, Any]]:
    """Build a smoother by its name.

    Args:
        name: A key of :data:`SMOOTHERS`.
        model: The compiled model.
        settings: Settings that differ from the defaults, as words.

    Returns:
        The smoother and all its settings.

    Raises:
        InputError: An unknown smoother or setting, or a value that does not fit.
    """
    if name not in SMOOTHERS:
        raise InputError(f"{name!r} is no smoother", field="--method", expected=", ".join(SMOOTHERS))
    entry = SMOOTHERS[name]
    defaults = entry.defaults
    chosen = {key: _parse(name, key, word, defaults) for key, word in settings.items()}
    try:
        return entry.build(model, **chosen), {**defaults, **chosen}
    except ValueError as error:
        raise InputError(str(error), field="--set") from error


def _parse(name: str, key: str, word: str, defaults: Mapping[str, Any]) -> Any:
    if key not in defaults:
        takes = ", ".join(f"{known}={default}" for known, default in defaults.items()) or "no settings"
        raise InputError(f"the smoother {name!r} has no setting {key!r}", field="--set", expected=takes)
    kind = type(defaults[key])
    if kind is bool:
        if word.lower() not in ("true", "false"):
            raise InputError(f"{key}={word}", field="--set", expected="true or false")
        return word.lower() == "true"
    try:
        return kind(word)
    except ValueError as error:
        expected = {int: "a whole number", float: "a number"}.get(kind, kind.__name__)
        raise InputError(f"{key}={word}", field="--set", expected=expected) from error
