"""Earlier data as predictors: programs that read the data of earlier frames.

    x_t ~ p(x | x_t-1, y_t-1, ..., y_t-p),      y_t ~ p(y | x_t, y_t-1, ..., y_t-p)

Autoregressions, GARCH, leverage and autoregressive hidden Markov models are such. The transition and the observation program
get a fourth argument, `previous`: for each site the last p values, oldest first, so that `previous["y"][-1]` is the one of the
frame before. `StateSpaceModel(..., before={"y": values})` has those before the first frame, and thereby the sites and p.

The compiled model takes earlier data as inputs, which drivers make of the data (:mod:`poseppl.program.earlier_inputs`). A
missing datum has no value to read later: it is refused, or, with ``impute=True``, becomes a site of the next frame's state,

    y_t-1 ~ p(y | x_t-1, y_t-2, ...)    where it is missing, and the datum itself where it was seen,

so that filters integrate it out as they do the rest of the state.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax import Array

from poseppl.errors import InputError, UnsuitableModelError
from poseppl.program.compiled import CompiledModel, Inputs
from poseppl.program.execution import trace_program
from poseppl.program.explanation import suggestion
from poseppl.program.observation import Observation
from poseppl.program.prediction import why_not_predictive
from poseppl.program.returned import Returned


class Window(NamedTuple):
    """The last p data of each site that is read later, oldest first.

    Attributes:
        values: Values (p, ...) by site; those that were not seen have no meaning.
        seen: Booleans of the same shapes.
    """

    values: dict[str, Any]
    seen: dict[str, Any]


class WithEarlier(NamedTuple):
    """Inputs of a model whose earlier data are predictors, at one frame or with a leading T.

    Attributes:
        inputs: Inputs of the programs.
        window: The data before the frame.
        inputs_before: The inputs of the frame before, where missing data are imputed; else None.
    """

    inputs: Any
    window: Window
    inputs_before: Any = None


@dataclasses.dataclass(frozen=True, eq=False)
class EarlierDataModel(CompiledModel):
    """A compiled model whose programs read earlier data; each `inputs` is a :class:`WithEarlier`.

    Attributes:
        before: The data before the first frame (p, ...) by site.
        impute: Whether missing data are sites of the state.
    """

    before: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    impute: bool = False

    def log_observation(self, x: Array, observation: Observation, inputs: Inputs = None) -> Array:
        """Log-likelihood of a frame's data; NaN if earlier data are missing that are not imputed."""
        found: Array = super().log_observation(x, observation, inputs) + self._nan_if_missing(inputs)
        return found

    def observation_moments(self, x: Array, inputs: Inputs = None) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k) of a frame's data; NaN if earlier data are missing that are not imputed."""
        mean, covariance = super().observation_moments(x, inputs)
        return mean + self._nan_if_missing(inputs), covariance

    def _nan_if_missing(self, inputs: Any) -> Any:
        """0; NaN if earlier data are missing that are not imputed. Drivers refuse such data where they know them."""
        if self.impute:
            return 0.0
        seen = jnp.stack([jnp.all(mask) for mask in inputs.window.seen.values()])
        return jnp.where(jnp.all(seen), 0.0, jnp.nan)

    @property
    def empty_window(self) -> Window:
        """The data before the first frame."""
        return Window(dict(self.before), {name: np.ones(np.shape(values), bool) for name, values in self.before.items()})


def compile_with_earlier_data(programs: Any, inputs: Any, params: Any) -> EarlierDataModel:
    """Compile programs that read earlier data; :meth:`poseppl.program.StateSpaceModel.compile` calls it.

    Raises:
        ValueError: The programs do not make a model.
        InputError: `before` is not of its data sites.
        UnsuitableModelError: Missing data cannot be imputed.
    """
    before = {name: np.asarray(values) for name, values in programs.before.items()}
    _check_before(before)
    before = {name: values.astype(jnp.result_type(jnp.asarray(values))) for name, values in before.items()}
    window = Window(before, {name: np.ones(values.shape, bool) for name, values in before.items()})
    wrapped = _imputing(programs, before) if programs.impute else _reading(programs)
    example = WithEarlier(inputs, window, inputs if programs.impute else None)
    compiled = wrapped.compile(example, params)
    _check_sites(before, compiled, programs.impute)
    fields = {field.name: getattr(compiled, field.name) for field in dataclasses.fields(CompiledModel)}
    return EarlierDataModel(**fields, before=before, impute=programs.impute)


def _check_before(before: Mapping[str, Any]) -> None:
    if not before:
        raise InputError("it names no site", field="before", expected="the values before the first frame, {site: (p, ...)}")
    for name, values in before.items():
        if values.ndim == 0 or not len(values) or values.dtype.kind not in "fiub":
            given = f"{values.dtype} of shape {values.shape}"
            raise InputError(f"{name!r} is {given}", field="before", expected="the last p values, (p, ...), oldest first")
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            expected = "numbers; mask the first frames' data (NaN), with impute=True, for values that follow from the model"
            raise InputError(f"{name!r} is not finite", field="before", expected=expected)


def _check_sites(before: Mapping[str, Any], model: CompiledModel, impute: bool) -> None:
    """Compare the sites of `before` with the data sites of a compiled model."""
    for name, values in before.items():
        declared = model.observation_sites.get(name)
        if declared is None:
            hint = suggestion(name, model.observation_sites)
            raise InputError(f"{name!r} is no data site{hint}", field="before", expected=str(list(model.observation_sites)))
        if values.shape[1:] != declared.shape or (values.dtype.kind == "f") != (declared.kind == "float"):
            expected = f"{declared.kind} of shape (p, {', '.join(map(str, declared.shape))})"
            raise InputError(f"{name!r} is {values.dtype} of shape {values.shape}", field="before", expected=expected)
        tied = () if model.dependent is None else {*model.dependent.parents, *sum(model.dependent.parents.values(), [])}
        if impute and name in tied:
            raise UnsuitableModelError(
                f"Missing data of site {name!r} cannot be imputed, because it depends on another data site of its frame, or "
                "that on it. Write both as one MultivariateNormal, or leave impute=True out."
            )


def _reading(programs: Any) -> Any:
    """Programs of three arguments, which take earlier data from their inputs."""

    def previous(inputs: WithEarlier) -> dict[str, Array]:
        return {name: _unknown(values, inputs.window.seen[name]) for name, values in inputs.window.values.items()}

    return programs._replace(
        initial=lambda params, inputs: programs.initial(params, inputs.inputs),
        transition=lambda params, state, inputs: programs.transition(params, state, inputs.inputs, previous(inputs)),
        observation=lambda params, state, inputs: programs.observation(params, state, inputs.inputs, previous(inputs)),
        before=None,
        impute=False,
    )


def _unknown(values: Any, seen: Any) -> Array:
    """Values, NaN where they were not seen and are real."""
    array = jnp.asarray(values)
    return jnp.where(seen, array, jnp.nan) if jnp.issubdtype(array.dtype, jnp.floating) else array


def _imputing(programs: Any, before: Mapping[str, Any]) -> Any:
    """Programs of three arguments, which keep earlier data in their state: `y_previous`, and for p > 1 `y_earlier`."""

    def split(state: Mapping[str, Array]) -> tuple[dict[str, Array], dict[str, Array]]:
        """The programs' own state, and the window."""
        own = {name: value for name, value in state.items() if name not in names}
        return own, {name: _joined(state, name, len(values)) for name, values in before.items()}

    names = {each for name, values in before.items() for each in _names(name, len(values))}

    def initial(params: Any, inputs: WithEarlier) -> None:
        programs.initial(params, inputs.inputs)
        for name, values in before.items():
            window = jnp.asarray(values)
            numpyro.sample(f"{name}_previous", Returned(window[-1], jnp.ones(window.shape[1:], bool)))
            _sample_earlier(name, window[:-1])

    def transition(params: Any, state: Mapping[str, Array], inputs: WithEarlier) -> None:
        own, window = split(state)
        data = {name: values[-1] for name, values in inputs.window.values.items()}
        trace = trace_program(programs.observation, (params, own, inputs.inputs_before, window), values=data)
        obstacle = why_not_predictive(trace)
        if obstacle is not None:
            raise UnsuitableModelError(f"Missing data cannot be imputed: {obstacle}. Leave impute=True out.")
        for name, values in window.items():
            latest = Returned(data[name], inputs.window.seen[name][-1], _law(trace, name))
            latest = numpyro.sample(f"{name}_previous", latest)
            _sample_earlier(name, values[1:])
            window[name] = jnp.concatenate([values[1:], latest[None]])
        programs.transition(params, own, inputs.inputs, window)

    def observation(params: Any, state: Mapping[str, Array], inputs: WithEarlier) -> None:
        own, window = split(state)
        programs.observation(params, own, inputs.inputs, window)

    return programs._replace(initial=initial, transition=transition, observation=observation, before=None, impute=False)


def _law(trace: Mapping[str, Any], name: str) -> dist.Distribution:
    if name not in trace or trace[name]["type"] != "sample":
        raise InputError(f"{name!r} is no data site", field="before", expected=f"some of {list(trace)}")
    law: dist.Distribution = trace[name]["fn"]
    return law


def _names(name: str, lags: int) -> list[str]:
    return [f"{name}_previous", *([f"{name}_earlier"] if lags > 1 else [])]


def _joined(state: Mapping[str, Array], name: str, lags: int) -> Array:
    latest = state[f"{name}_previous"][None]
    return jnp.concatenate([state[f"{name}_earlier"], latest]) if lags > 1 else latest


def _sample_earlier(name: str, values: Array) -> None:
    """Sample the data before the last, which are those of the state before."""
    if len(values):
        numpyro.sample(f"{name}_earlier", dist.Delta(values))
