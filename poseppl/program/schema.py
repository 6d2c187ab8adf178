"""Check the programs of a model when it is compiled.

NumPyro lets through in silence what a state-space model cannot mean: a seeded program samples a missing site, extra sites
are ignored, broadcastable shapes broadcast. Here each program is traced once, abstractly, and what it declares is compared
with what the initial program declares. Every error names the site, what was found, what was expected, and the cure.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax import Array
from numpyro.distributions import constraints

from poseppl.compilation import jit
from poseppl.program.bijector import Site, integer_bounds, is_flat_support, make_site
from poseppl.program.dependence import output_dependence
from poseppl.program.diffuse import Diffuse
from poseppl.program.execution import Program, RngBudget, Seed, base_support, is_factor, is_masked, trace_program, unwrap
from poseppl.program.explanation import explained, suggestion
from poseppl.program.normal_sites import is_plain


class Programs(Protocol):
    """Three NumPyro programs, and a fourth or None, as :class:`poseppl.program.StateSpaceModel` describes them."""

    @property
    def initial(self) -> Callable[[Any, Any], Any]:
        """Samples the state at the first frame."""

    @property
    def transition(self) -> Callable[[Any, dict[str, Any], Any], Any]:
        """Samples the state at a later frame."""

    @property
    def observation(self) -> Callable[[Any, dict[str, Any], Any], Any]:
        """Samples the data."""

    @property
    def parameters(self) -> Callable[[], Any] | None:
        """Samples what does not change over time."""


class Declared(NamedTuple):
    """Declaration of one sample site by one program.

    Attributes:
        shape: Shape of its value.
        dtype: Its dtype.
        event_dim: Event dimensions of its distribution.
        support: Its support; None where it depends on arguments or draws.
        observed: Whether it was given `obs=`.
        noiseless: Whether it is a function of what it depends on (`Delta`).
        divisible: Whether single entries of its events may be missing (`MultivariateNormal`).
        diffuse: Whether it has a flat prior (`Diffuse`).
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    event_dim: int
    support: Any
    observed: bool
    noiseless: bool = False
    divisible: bool = False
    diffuse: bool = False

    @property
    def size(self) -> int:
        """Entries of its value."""
        return math.prod(self.shape)

    @property
    def kind(self) -> str:
        """One of float, integer, boolean, complex."""
        return {"f": "float", "i": "integer", "u": "integer", "b": "boolean", "c": "complex"}[self.dtype.kind]


class Declaration(NamedTuple):
    """All that one program declares.

    Attributes:
        sites: Its sample sites.
        factors: Its factors.
        weighed: Sample sites whose density a scale or a mask changes.
        deterministic: Its deterministic values.
        randomness: The random numbers that a draw uses.
    """

    sites: dict[str, Declared]
    factors: tuple[str, ...]
    weighed: tuple[str, ...]
    deterministic: tuple[str, ...]
    randomness: RngBudget


def declare(which: str, program: Program, arguments: tuple[Any, ...], state: Iterable[str] = ()) -> Declaration:
    """Trace a program abstractly and describe its sites.

    Args:
        which: Name of the program, for messages.
        program: The NumPyro program.
        arguments: Its arguments; arrays (or their shapes) and floats are traced, anything else is passed unchanged.
        state: Names of the state's sites, to suggest in messages.

    Raises:
        ValueError: A name used twice, a `numpyro.param` site, a name looked up that does not exist, draws that are no site,
            an improper distribution, or arguments that the program cannot use.
    """
    leaves, tree = jax.tree.flatten(arguments)
    traced = [isinstance(a, Array | np.ndarray | np.generic | float | jax.ShapeDtypeStruct) for a in leaves]
    found: dict[str, Any] = {}
    trees: dict[str, Any] = {}
    counts: list[RngBudget] = []

    def run(rng_key: Array, arrays: list[Any]) -> dict[str, list[Any]]:
        rest = iter(arrays)
        full = [next(rest) if is_traced else leaf for leaf, is_traced in zip(leaves, traced, strict=True)]
        seed = Seed(rng_key, None)
        found.update(trace_program(program, jax.tree.unflatten(tree, full), seed=seed))
        counts.append(seed.counted)
        bounds = {}
        for name, site in found.items():
            if site["type"] == "sample" and not is_factor(site):
                bounds[name], trees[name] = jax.tree.flatten(site["fn"].support)
        return bounds

    arrays = [leaf for leaf, is_traced in zip(leaves, traced, strict=True) if is_traced]
    with explained(which, state, arguments):
        closed, shapes = jax.make_jaxpr(run, return_shape=True)(jax.random.key(0), arrays)
    for name, site in found.items():
        if site["type"] == "param":
            raise ValueError(
                f"The {which} program has a numpyro.param site {name!r}, whose value would silently stay at its initial "
                "one. Pass it in params, or sample it in the parameters program."
            )
    reached = iter(output_dependence(closed, [frozenset({0})] * len(closed.jaxpr.invars)))
    fixed = {name: not any([next(reached) for _ in bounds]) for name, bounds in shapes.items()}
    supports = _constant_supports(run, arrays, trees, fixed)
    sites = {}
    for name in (name for name in found if name in fixed):
        site, fn = found[name], found[name]["fn"]
        dtype = np.dtype(jnp.result_type(site["value"]))
        kind = isinstance(unwrap(fn), dist.Delta), is_plain(site, dist.MultivariateNormal), is_plain(site, Diffuse)
        if kind[2] and which != "initial":
            raise ValueError(f"Site {name!r} of the {which} program is Diffuse. Expected it in the initial program alone.")
        sites[name] = Declared(tuple(fn.shape()), dtype, fn.event_dim, supports[name], bool(site["is_observed"]), *kind)
    factors = tuple(name for name, site in found.items() if is_factor(site))
    weighed = tuple(name for name in sites if found[name].get("scale") is not None or is_masked(found[name]["fn"]))
    deterministic = tuple(name for name, site in found.items() if site["type"] == "deterministic")
    return Declaration(sites, factors, weighed, deterministic, counts[0])


def _constant_supports(run: Any, arrays: list[Any], trees: dict[str, Any], fixed: dict[str, bool]) -> dict[str, Any]:
    """Supports with concrete bounds, for the sites whose bounds depend on nothing."""
    if all(tree.num_leaves == 0 for tree in trees.values()):
        return {name: jax.tree.unflatten(tree, []) for name, tree in trees.items()}
    zeros = [np.zeros(np.shape(a), getattr(a, "dtype", float)) for a in arrays]
    with jax.ensure_compile_time_eval(), numpyro.validation_enabled(False):  # zeros need be no scales or probabilities
        # as arguments, which are not folded operation by operation, each compiled by itself
        bounds = jit(run)(jax.random.key(0), zeros)
    return {
        name: jax.tree.unflatten(tree, [np.asarray(b) for b in bounds[name]]) if fixed[name] else None
        for name, tree in trees.items()
    }


_INTEGERS = constraints.integer_greater_than(-np.inf)
"""The support of integers whose bounds move, such as a Binomial's of a total that is a state."""


def state_layout(initial: Declaration, transition: Declaration | None = None) -> dict[str, Site]:
    """Lay out the state from the sites of the initial program.

    Args:
        initial: Its declaration.
        transition: That of the transition, where it is known: bounds of integers may depend on something in it alone.

    Raises:
        ValueError: No site, a factor, `obs=`, real bounds that depend on arguments or draws, or complex values.
    """
    if not initial.sites and not initial.factors:
        raise ValueError("The initial program has no sample site: sample each part of the state with numpyro.sample.")
    _check_state_program("initial", initial)
    sites: dict[str, Site] = {}
    offset = 0
    for name, declared in initial.sites.items():
        if declared.kind == "complex":
            raise ValueError(f"State site {name!r} is complex: sample its real and imaginary part as two sites.")
        discrete = declared.kind in ("integer", "boolean")
        later = declared if transition is None else transition.sites.get(name, declared)
        support = _INTEGERS if discrete and _move(declared.support, later.support) else declared.support
        sites[name] = make_site(name, declared.shape, declared.dtype, support, discrete, offset)
        offset += sites[name].size
    return sites


def _move(first: Any, later: Any) -> bool:
    """Whether bounds of integers depend on something, or those of the first frame are not those of later ones."""
    if first is None or later is None:
        return True
    return not _same_support(first, later) and None in (integer_bounds(first), integer_bounds(later))


def _check_state_program(which: str, declaration: Declaration) -> None:
    if declaration.factors:
        raise ValueError(
            f"The {which} program has a numpyro.factor site {declaration.factors[0]!r}: its density would no longer be the "
            "one that it draws from. Factors belong in the observation program."
        )
    if declaration.weighed:
        raise ValueError(
            f"The {which} program scales or masks the density of site {declaration.weighed[0]!r}, which would no longer be the "
            "one that it draws from. Scales and masks belong in the observation program: choose between two laws by jnp.where "
            "on their arguments."
        )
    _check_not_observed(which, declaration)
    for name, declared in declaration.sites.items():
        if declared.support is None and declared.kind == "float":
            raise ValueError(
                f"The support of site {name!r} in the {which} program depends on the state, params, inputs or another site. "
                "Expected constant bounds, so that one bijector serves every frame: sample an unbounded or unit-interval value "
                "and map it in the observation program."
            )


def _check_not_observed(which: str, declaration: Declaration) -> None:
    for name, declared in declaration.sites.items():
        if declared.observed:
            raise ValueError(
                f"Site {name!r} in the {which} program was given obs=. Leave obs= out: data are passed to the filter, "
                "as an Observation made by observe()."
            )


def check_transition(state: Mapping[str, Site], transition: Declaration) -> None:
    """Compare the sites of the transition program with the state.

    Raises:
        ValueError: A missing, extra or misspelt site, another shape, dtype kind or support, `obs=` or a factor.
    """
    for name in transition.sites:
        if name not in state:
            missing = [n for n in state if n not in transition.sites]
            raise ValueError(
                f"The transition program samples {name!r}, which the initial program does not{suggestion(name, missing)}. "
                f"Expected exactly the state's sites {list(state)}: rename it, or add it to the initial program."
            )
    for name, site in state.items():
        if name not in transition.sites:
            raise ValueError(
                f"The transition program does not sample the state site {name!r}; it samples {list(transition.sites)}. "
                "Sample every state site, in any order."
            )
        declared = transition.sites[name]
        if declared.shape != site.shape:
            raise ValueError(
                f"State site {name!r} has shape {declared.shape} in the transition program and {site.shape} in the initial "
                "one. Expected equal shapes (broadcastable is not enough): expand the distribution."
            )
        if declared.dtype.kind != site.dtype.kind:
            raise ValueError(
                f"State site {name!r} is {declared.kind} ({declared.dtype}) in the transition program and {site.dtype} in "
                "the initial one. Expected the same kind: use distributions of one kind in both."
            )
    _check_state_program("transition", transition)
    for name, site in state.items():
        if site.support is not _INTEGERS and not _same_support(site.support, transition.sites[name].support):
            raise ValueError(
                f"State site {name!r} has support {transition.sites[name].support} in the transition program and "
                f"{site.support} in the initial one. Expected equal supports: use distributions over the same set in both."
            )


def _same_support(first: Any, second: Any) -> bool:
    if is_flat_support(first) and is_flat_support(second):
        return True
    one, other = base_support(first), base_support(second)
    return bool(one == other or other == one)


def check_observation(observation: Declaration) -> None:
    """Check that the observation program has data sites or factors.

    Raises:
        ValueError: Neither a sample site nor a factor, or `obs=` left in the program.
    """
    _check_not_observed("observation", observation)
    if not observation.sites and not observation.factors:
        raise ValueError(
            "The observation program has neither a sample site nor a numpyro.factor: the data would say nothing. "
            "Sample each observed quantity with numpyro.sample, without obs=."
        )
