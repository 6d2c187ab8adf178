"""Several transitions between two frames, and counts that start again at each frame: transformations of programs.

    with_substeps(programs, k)           x_t is what k transitions make of x_t-1
    with_reset(programs, "cases")        the transition into each frame finds 0 in a site that accumulates

The k - 1 states between two frames are a site of the state, `substeps`, so that the transition keeps a density,

    p(u_1, ..., u_k-1, x_t | x_t-1) = p(u_1 | x_t-1) p(u_2 | u_1) ... p(x_t | u_k-1),

and every algorithm takes the model. A Kalman filter integrates them out exactly where the programs are linear and Gaussian.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax import Array
from jax.scipy.linalg import block_diag
from numpyro import handlers
from numpyro.distributions import constraints

from poseppl.errors import InputError
from poseppl.program.bijector import LARGEST, Site, make_site
from poseppl.program.execution import (
    RngBudget,
    Seed,
    base_support,
    draw,
    has_derivative,
    log_density,
    sample_sites,
    trace_program,
    unwrap,
)
from poseppl.program.model import StateSpaceModel
from poseppl.program.state_moments import moments_form, state_moments

SITE = "substeps"
"""The site of the states between two frames."""


def with_substeps(programs: StateSpaceModel, number: int) -> StateSpaceModel:
    """Programs whose transition is made several times between two frames, each time with the inputs of the new frame.

    Args:
        programs: Programs whose transition is one sub-step; its step in time is up to them, such as `inputs["dt"] / number`.
        number: Transitions k between two frames.

    Returns:
        The programs, with a site `substeps` (k - 1 times the entries of the state) of the states in between, which has no
        meaning at the first frame. Programs do not see it.

    Raises:
        InputError: `number` is no integer of at least 1.
    """
    if number != int(number) or number < 1:
        raise InputError(f"{number}", field="number", expected="an integer, at least 1")
    if number == 1:
        return programs

    def initial(params: Any, inputs: Any) -> None:
        trace = sample_sites(trace_program(programs.initial, (params, inputs)))
        size = (number - 1) * sum(math.prod(site["fn"].shape()) for site in trace.values())
        programs.initial(params, inputs)
        numpyro.sample(SITE, dist.Normal(jnp.zeros(size), 1.0).to_event(1))

    def transition(params: Any, state: Mapping[str, Array], *rest: Any) -> None:
        own = _without_substeps(state)
        law = SubstepPath(programs.transition, number - 1, own, (params, *rest))
        path = numpyro.sample(SITE, law)
        with handlers.substitute(data=law.after):  # drawn with the path, by one sampler, which takes long to compile
            programs.transition(params, _unpacked(_layout(own), path.reshape(number - 1, -1)[-1]), *rest)

    def observation(params: Any, state: Mapping[str, Array], *rest: Any) -> None:
        programs.observation(params, _without_substeps(state), *rest)

    return programs._replace(initial=initial, transition=transition, observation=observation)


def with_reset(programs: StateSpaceModel, *sites: str) -> StateSpaceModel:
    """Programs whose transition into each frame finds 0 in some sites, which accumulate within a frame.

    With sub-steps, apply it last: `with_reset(with_substeps(programs, 7), "cases")` resets once a frame.

    Args:
        programs: Programs whose transition adds to the sites.
        sites: Names of these sites of the state.

    Raises:
        InputError: The state has no such site; when the model is compiled.
    """

    def transition(params: Any, state: Mapping[str, Array], *rest: Any) -> None:
        unknown = [name for name in sites if name not in state]
        if unknown:
            raise InputError(f"there is no site {unknown[0]!r}", field="sites", expected=f"some of {list(state)}")
        programs.transition(params, {**state, **{name: jnp.zeros_like(state[name]) for name in sites}}, *rest)

    return programs._replace(transition=transition)


class SubstepPath(dist.Distribution):  # type: ignore[misc]
    """The states that several transitions pass through, as one vector (k d,): of each the entries of its sites.

    Args:
        program: The transition program.
        length: Transitions k.
        start: State that they start from, by site.
        arguments: `(params, inputs, ...)`, the program's other arguments.

    Attributes:
        after: The state that one more transition leads to, by site, once the path was drawn.
    """

    arg_constraints: dict[str, Any] = {}
    support = constraints.real_vector
    pytree_data_fields = ("start", "arguments")
    pytree_aux_fields = ("program", "length")

    def __init__(self, program: Callable[..., Any], length: int, start: dict[str, Array], arguments: tuple[Any, ...]) -> None:
        self.program, self.length, self.start, self.arguments = program, length, start, arguments
        self.after: dict[str, Array] = {}
        super().__init__((), (length * sum(math.prod(jnp.shape(value)) for value in start.values()),), validate_args=False)

    @property
    def has_rsample(self) -> bool:
        """Whether each draw of the program has a derivative."""
        return all(has_derivative(site["fn"]) for site in self._sites().values())

    def sample(self, key: Array, sample_shape: tuple[int, ...] = ()) -> Array:
        """The states one after the other, NaN where an integer is not exact."""
        budget = self._budget()

        def step(state: dict[str, Array], key: Array) -> tuple[dict[str, Array], Array]:
            drawn = draw(self.program, self._given(state), key, budget)
            state = {name: drawn[name].astype(value.dtype) for name, value in state.items()}
            return state, _packed(state)

        start = {name: jnp.asarray(value) for name, value in self.start.items()}
        self.after, path = jax.lax.scan(step, start, jax.random.split(key, self.length + 1))
        return jnp.broadcast_to(path[:-1].ravel(), (*sample_shape, path[:-1].size))

    def log_prob(self, value: Array) -> Array:
        """Sum of the transitions' log-densities."""
        layout, path = _layout(self.start), value.reshape(self.length, -1)
        before = jnp.concatenate([_packed(self.start)[None], path[:-1]])

        def term(x: Array, before: Array) -> Array:
            return log_density(self.program, self._given(_unpacked(layout, before)), _unpacked(layout, x))

        total = jnp.sum(jax.vmap(term)(path, before))
        return total + _without_gradient(total) if self._loses_derivatives() else total

    @property
    def mean(self) -> Array:
        """Mean (k d,), exact where the program is linear."""
        return self._moments()[0]

    @property
    def variance(self) -> Array:
        """Variances (k d,)."""
        variance: Array = jnp.diagonal(self._moments()[1])
        return variance

    @property
    def covariance_matrix(self) -> Array:
        """Covariance (k d, k d), exact where the program is linear and Gaussian."""
        return self._moments()[1]

    def _moments(self) -> tuple[Array, Array]:
        """Moments of the path, each transition linearised at the mean of the one before.

        Raises:
            NotImplementedError: The program has no Gaussian moments.
        """
        sites, layout = self._flat_sites(), _layout(self.start)

        def step(x: Array) -> tuple[Array, Array]:
            given = self._given(_unpacked(layout, x))

            def trace_of(values: Any) -> Any:
                return trace_program(self.program, given, values=values)

            form = moments_form(sites, trace_of)
            if form.obstacle is not None:
                raise NotImplementedError(f"its transition has no Gaussian moments: {form.obstacle}")
            return state_moments(sites, trace_of, form)

        def path(deviations: Array) -> Array:
            def advance(x: Array, deviation: Array) -> tuple[Array, Array]:
                x = step(x)[0] + deviation
                return x, x

            return jax.lax.scan(advance, start, deviations)[1].ravel()

        start = _packed(self.start)
        nothing = jnp.zeros((self.length, len(start)), start.dtype)
        mean = path(nothing)
        jacobian = jax.jacfwd(path)(nothing).reshape(mean.size, mean.size)
        before = jnp.concatenate([start[None], mean.reshape(nothing.shape)[:-1]])
        covariance = jacobian @ block_diag(*jax.vmap(lambda x: step(x)[1])(before)) @ jacobian.T
        return mean, (covariance + covariance.T) / 2

    def _flat_sites(self) -> dict[str, Site]:
        """The program's sites as coordinates of a flat state."""
        sites: dict[str, Site] = {}
        offset, traced = 0, self._sites()
        for name, (shape, dtype) in _layout(self.start).items():
            if base_support(traced[name]["fn"].support) is not constraints.real:
                raise NotImplementedError(f"site {name!r} is not over the real line")
            discrete = not jnp.issubdtype(dtype, jnp.floating)
            sites[name] = make_site(name, shape, dtype, constraints.real, discrete, offset)
            offset += sites[name].size
        return sites

    def _given(self, state: dict[str, Array]) -> tuple[Any, ...]:
        return self.arguments[0], state, *self.arguments[1:]

    def _sites(self) -> dict[str, Any]:
        """The sites of one transition, of which the values have no meaning."""
        found: dict[str, Any] = {}
        jax.eval_shape(lambda: found.update(sample_sites(trace_program(self.program, self._given(self.start)))))
        return found

    def _budget(self) -> RngBudget:
        """The random numbers of one transition."""
        counted: list[RngBudget] = []

        def count() -> None:
            seed = Seed(jax.random.key(0), None)
            trace_program(self.program, self._given(self.start), seed=seed)
            counted.append(seed.counted)

        jax.eval_shape(count)
        return counted[0]

    def _loses_derivatives(self) -> bool:
        """Whether real values follow without noise from what has no derivative, such as integers."""
        laws = [unwrap(site["fn"]) for site in self._sites().values()]
        real = any(isinstance(law, dist.Delta) and jnp.issubdtype(jnp.result_type(law.v), jnp.floating) for law in laws)
        return real and not self.has_rsample


@jax.custom_jvp
def _without_gradient(value: Array) -> Array:
    """0, whose derivative is NaN: that of such a path is not known."""
    return jnp.zeros_like(value)


@_without_gradient.defjvp
def _unknown_gradient(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    return jnp.zeros_like(primals[0]), tangents[0] * jnp.nan


def _without_substeps(state: Mapping[str, Array]) -> dict[str, Array]:
    return {name: value for name, value in state.items() if name != SITE}


def _layout(state: Mapping[str, Any]) -> dict[str, tuple[tuple[int, ...], Any]]:
    """Shape and dtype of each site, in the order of names, which JAX's trees keep."""
    return {name: (jnp.shape(state[name]), jnp.result_type(state[name])) for name in sorted(state)}


def _packed(state: Mapping[str, Any]) -> Array:
    """The entries (d,) of all sites, NaN where an integer is not exact."""
    dtype = jnp.result_type(float)
    parts = []
    for name in sorted(state):
        flat = jnp.ravel(state[name])
        real = flat.astype(dtype)
        exact = jnp.issubdtype(flat.dtype, jnp.floating) or dtype != np.float32
        parts.append(real if exact else jnp.where(jnp.abs(real) < LARGEST, real, jnp.nan))
    return jnp.concatenate(parts)


def _unpacked(layout: Mapping[str, tuple[tuple[int, ...], Any]], x: Array) -> dict[str, Array]:
    values, offset = {}, 0
    for name, (shape, dtype) in layout.items():
        size = math.prod(shape)
        value = x[offset : offset + size].reshape(shape)
        values[name] = value if jnp.issubdtype(dtype, jnp.floating) else jnp.round(value).astype(dtype)
        offset += size
    return values
