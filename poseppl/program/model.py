"""A state-space model as NumPyro programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from poseppl.program import schema
from poseppl.program.compiled import CompiledModel
from poseppl.program.dependent_data import DependentData, dependent_data
from poseppl.program.earlier_data import compile_with_earlier_data
from poseppl.program.execution import RngBudget, trace_program
from poseppl.program.large_integers import with_large_integers


class StateSpaceModel(NamedTuple):
    """Three NumPyro programs, and a fourth for what does not change over time.

    Attributes:
        initial: `(params, inputs)`: samples the state's sites at the first frame. Their names, shapes and order are the state.
        transition: `(params, state, inputs)`: samples the same sites at a frame, given the state (values by name) at the frame
            before it and the inputs of the new frame.
        observation: `(params, state, inputs)`: every sample site is data (without `obs=`); `numpyro.factor` adds a heuristic
            log-likelihood; `numpyro.deterministic` sites come back as extras.
        parameters: `()`: optional prior over params, a dict of sites.
        before: Values (p, ...) of data sites before the first frame, oldest first, for programs that read earlier data:
            `transition` and `observation` get a fourth argument, `previous`, with the last p values of these sites
            (:mod:`poseppl.program.earlier_data`).
        impute: Whether missing data that are read later are sites of the state, `SITE_previous`; otherwise they are refused.
    """

    initial: Callable[[Any, Any], Any]
    transition: Callable[..., Any]
    observation: Callable[..., Any]
    parameters: Callable[[], Any] | None = None
    before: Mapping[str, Any] | None = None
    impute: bool = False

    def compile(self, inputs: Any = None, params: Any = None) -> CompiledModel:
        """Check the programs and make pure single-particle functions of them.

        Args:
            inputs: The inputs of one frame, a pytree of arrays (or of their shapes) or None; only shapes and dtypes count.
            params: Passed to the programs as `params`. Without it, a model with a parameters program is checked with a draw
                from that program, and `with_params` has to be called before use.

        Raises:
            ValueError: The programs do not make a state-space model; the message names the site and the cure.
        """
        if self.before is not None:
            return compile_with_earlier_data(self, inputs, params)
        randomness: dict[str, RngBudget] = {}
        unbound = params is None and self.parameters is not None
        example = params
        if self.parameters is not None:
            declared = schema.declare("parameters", self.parameters, ())
            randomness["parameters"] = declared.randomness
            if unbound:
                example = {n: np.zeros(site.shape, site.dtype) for n, site in declared.sites.items()}
        inputs = jax.tree.map(lambda a: a if isinstance(a, jax.ShapeDtypeStruct) else jnp.asarray(a), inputs)
        initial = schema.declare("initial", self.initial, (example, inputs))
        sites = schema.state_layout(initial)
        state = {name: np.zeros(site.shape, site.dtype) for name, site in sites.items()}
        transition = schema.declare("transition", self.transition, (example, state, inputs), sites)
        sites = schema.state_layout(initial, transition)
        schema.check_transition(sites, transition)
        if not unbound:
            sites = with_large_integers(sites, self.initial, params, inputs)
        observation = schema.declare("observation", self.observation, (example, state, inputs), sites)
        schema.check_observation(observation)
        drawn = {"initial": initial, "transition": transition, "observation": observation}
        randomness |= {which: declared.randomness for which, declared in drawn.items()}
        shapes = jax.eval_shape(lambda leaves: leaves, inputs)
        dependent = self._dependence_of_data(observation.sites, (example, state, inputs))
        noiseless = tuple(
            name
            for name, site in sites.items()
            if not site.discrete and (initial.sites[name].noiseless or transition.sites[name].noiseless)
        )
        diffuse = tuple(name for name in sites if initial.sites[name].diffuse)
        return CompiledModel(self, sites, observation.sites, randomness, params, unbound, shapes, noiseless, dependent, diffuse)

    def _dependence_of_data(self, sites: dict[str, Any], arguments: tuple[Any, ...]) -> DependentData | None:
        """How data sites depend on one another, at arguments of which shapes alone may be known."""
        leaves, tree = jax.tree.flatten(arguments)
        found: list[DependentData | None] = []

        def look(given: list[Any]) -> None:
            rest = iter(given)
            full = [next(rest) if isinstance(leaf, jax.ShapeDtypeStruct) else leaf for leaf in leaves]
            known = jax.tree.unflatten(tree, full)
            found.append(dependent_data(sites, lambda values: trace_program(self.observation, known, values=values)))

        jax.eval_shape(look, [leaf for leaf in leaves if isinstance(leaf, jax.ShapeDtypeStruct)])
        return found[0]

    def __getattr__(self, name: str) -> Any:
        """Say what to do where a model is used that is not compiled."""
        if name in vars(CompiledModel) or name in CompiledModel.__dataclass_fields__:
            raise AttributeError(f"The model has no {name!r} before it is compiled: use model.compile(inputs, params).")
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
