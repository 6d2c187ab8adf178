"""Clamping: the model of some sites of the state, with all the others given frame by frame.

It is a transformation of the programs. The clamped sites are substituted, both in the state that a program gets and in what it
samples. They are also blocked: they add nothing to a density and draw nothing. With the free sites f and the clamped ones c,

    p(f_t | c_t, f_t-1, c_t-1)   and   p(z_t | f_t, c_t),

as functions of f, the first as the program factors it: each free site given what is sampled before it. So densities, draws,
moments and the evidence, that of the data given the clamped values, belong to one model.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpyro import handlers

from poseppl.program import bijector
from poseppl.program.compiled import CompiledModel, Inputs
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.model import StateSpaceModel


class Clamped(NamedTuple):
    """Inputs of a clamped model at one frame.

    Attributes:
        inputs: The full model's inputs.
        values: Full flat state (d_full,) of this frame; its free entries are not read.
        previous: Full flat state (d_full,) of the frame before; not read at the first frame.
    """

    inputs: Any
    values: Array
    previous: Array

    @classmethod
    def of_trajectory(cls, values: Any, inputs: Any = None) -> Clamped:
        """Stacked inputs for a whole sequence, from full flat states (T, d_full) and the full model's inputs."""
        states = jnp.asarray(values)
        return cls(inputs, states, jnp.concatenate([states[:1], states[:-1]]))


@dataclasses.dataclass(frozen=True, eq=False)
class ClampedModel(CompiledModel):
    """The model of some sites of a full model; every `inputs` is a `Clamped`.

    Attributes:
        full: The full model.
    """

    full: CompiledModel = None  # type: ignore[assignment]

    def with_params(self, params: Any) -> ClampedModel:
        """The same model with other params."""
        return dataclasses.replace(self, params=params, unbound=False, full=self.full.with_params(params))

    def to_sites(self, x: Array, inputs: Inputs = None) -> dict[str, Array]:
        """Constrained values of all sites of the full state."""
        return self.full.to_sites(_required(inputs).values) | bijector.to_sites(self.sites, x)

    def _arguments(self, inputs: Inputs, x: Array | None = None) -> tuple[Any, ...]:
        return super()._arguments(_required(inputs), x)


def clamp(model: CompiledModel, free: Sequence[int | str]) -> ClampedModel:
    """The model of some sites of `model`, with the others given by `Clamped` inputs; the same one for the same sites.

    Args:
        model: The full model.
        free: The sites that stay free: their names, or names or indices of all their coordinates. They keep their order.

    Raises:
        ValueError: No site, an unknown or repeated one, a part of one, or a model that is clamped already.
    """
    if isinstance(model, ClampedModel):
        raise ValueError("The model is clamped already: clamp the full model (model.full) with all that should be given.")
    return _clamped(model, frozenset(_free_sites(model, free)))


@memoized_builder
def _clamped(model: CompiledModel, free: frozenset[str]) -> ClampedModel:
    programs = _clamped_programs(model, free)
    state = jnp.zeros(model.dimension)
    compiled = programs.compile(Clamped(model.input_shapes, state, state), model.params)
    split = [name for name, site in model.sites.items() if site.split]
    fields = {field.name: getattr(compiled, field.name) for field in dataclasses.fields(CompiledModel)}
    fields["sites"] = bijector.laid_out(compiled.sites, split)
    # a full model that was compiled for no inputs takes any
    shapes = None if model.input_shapes is None else compiled.input_shapes
    return ClampedModel(**fields | {"input_shapes": shapes, "unbound": model.unbound}, full=model)


def _clamped_programs(model: CompiledModel, free: frozenset[str]) -> StateSpaceModel:
    """The programs with all sites but the free ones substituted and blocked."""
    sites = {name: site for name, site in model.sites.items() if name not in free}

    def given(values: Array) -> dict[str, Array]:
        return bijector.to_sites(sites, values)

    def clamped(program: Callable[..., Any]) -> Callable[..., Any]:
        def run(params: Any, *state: Mapping[str, Any], inputs: Clamped) -> None:
            whole = (dict(part) | given(inputs.previous) for part in state)
            with handlers.block(hide=list(sites)), handlers.substitute(data=given(inputs.values)):
                program(params, *whole, inputs.inputs)

        return run

    initial, transition = clamped(model.programs.initial), clamped(model.programs.transition)
    return StateSpaceModel(
        lambda params, inputs: initial(params, inputs=inputs),
        lambda params, state, inputs: transition(params, state, inputs=inputs),
        lambda params, state, inputs: model.programs.observation(params, dict(state) | given(inputs.values), inputs.inputs),
        model.programs.parameters,
    )


def _free_sites(model: CompiledModel, free: Sequence[int | str]) -> set[str]:
    """Names of the sites that are free."""
    owners = [name for name, site in model.sites.items() for _ in range(site.size)]
    chosen: list[int] = []
    for item in free:
        if isinstance(item, str) and item in model.sites:
            chosen += np.flatnonzero([owner == item for owner in owners]).tolist()
        elif isinstance(item, str) and item not in model.coordinate_names:
            raise ValueError(f"free names {item!r}, which is no site. Expected some of {list(model.sites)}.")
        else:
            chosen.append(model.coordinate_names.index(item) if isinstance(item, str) else int(item))
    if not chosen or len(set(chosen)) != len(chosen) or not all(0 <= i < model.dimension for i in chosen):
        raise ValueError(f"free is {list(free)}. Expected distinct sites, at least one, of {list(model.sites)}.")
    names = {owners[index] for index in chosen}
    for name in names:
        if sum(owner == name for owner in owners) != sum(owners[index] == name for index in chosen):
            raise ValueError(f"free has a part of site {name!r}. Expected whole sites: sample what is clamped as its own.")
    return names


def _required(inputs: Any) -> Clamped:
    if not isinstance(inputs, Clamped):
        found = type(inputs).__name__
        raise ValueError(f"A clamped model got inputs of type {found}. Expected Clamped(inputs, values, previous).")
    return inputs
