"""A compiled model: pure functions of one particle, which every algorithm shares."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.errors import UnsuitableModelError
from poseppl.program import bijector
from poseppl.program.bijector import Site
from poseppl.program.dependent_data import (
    DependentData,
    check_parents_seen,
    information_of_group,
    log_densities_of_events,
    log_density_of_seen,
    moments_of_data,
)
from poseppl.program.execution import (
    RngBudget,
    Seed,
    Trace,
    Values,
    any_event_mask,
    derivative_only,
    draw,
    has_derivative,
    log_density,
    masked_event_log_densities,
    sample_sites,
    site_log_density,
    trace_log_density,
    trace_program,
)
from poseppl.program.explanation import check_inputs
from poseppl.program.moments import (
    flat_observation,
    is_gaussian,
    observation_information,
    observation_jacobian,
    observation_moments,
)
from poseppl.program.normal_sites import joint_normal
from poseppl.program.observation import Observation, feasible, observe
from poseppl.program.prediction import DrawnData, drawn_data, why_not_predictive
from poseppl.program.resolution import Resolution
from poseppl.program.schema import Declared, Programs
from poseppl.program.state_moments import MomentsForm, moments_form, same_frame_dependence, state_moments

Inputs = Any

_MAX_VALUES = 1000
"""Values of a site up to which it counts as one of states, rather than of counts."""


@dataclasses.dataclass(frozen=True, eq=False)
class CompiledModel:
    """Pure functions of a single particle, to be vmapped, differentiated and jitted as needed.

    `x` is always the flat unconstrained state (d,), and densities of `x` include the log-determinant of its bijector.
    `StateSpaceModel.compile` makes it; `inputs` is what is known at the frame of `x` (see `poseppl.program`).

    Attributes:
        programs: The NumPyro programs.
        sites: The state's sites by name, in the order of the flat vector.
        observation_sites: The observation's data sites by name.
        randomness: The random numbers that a draw from each program uses, by the program's name.
        params: Passed to the programs as `params`; may contain tracers.
        unbound: Whether params are still to be set by `with_params`.
        input_shapes: The inputs of one frame that it was compiled for, as shapes; None where it was compiled for none.
        noiseless: Names of the state's real sites that follow from others without noise (`Delta`), at first or later.
        dependent: How data sites depend on one another within a frame; None if they do not.
        diffuse: Names of the state's sites of which nothing is known at the start (`Diffuse`).
    """

    programs: Programs
    sites: dict[str, Site]
    observation_sites: dict[str, Declared]
    randomness: dict[str, RngBudget]
    params: Any = None
    unbound: bool = False
    input_shapes: Any = None
    noiseless: tuple[str, ...] = ()
    dependent: DependentData | None = None
    diffuse: tuple[str, ...] = ()

    @property
    def dimension(self) -> int:
        """Length d of the flat state."""
        return sum(site.size for site in self.sites.values())

    @property
    def diffuse_coordinates(self) -> tuple[bool, ...]:
        """Whether nothing is known of each of the d coordinates at the start."""
        return tuple(name in self.diffuse for name, site in self.sites.items() for _ in range(site.size))

    @property
    def finite_sites(self) -> tuple[str, ...]:
        """Names of the sites that take integers."""
        return tuple(name for name, site in self.sites.items() if site.discrete)

    @property
    def finite_coordinates(self) -> tuple[bool, ...]:
        """Whether each of the d coordinates takes integers."""
        return tuple(site.discrete for site in self.sites.values() for _ in range(site.size))

    @property
    def circular_coordinates(self) -> tuple[bool, ...]:
        """Whether each of the d coordinates is an angle."""
        return tuple(site.circular for site in self.sites.values() for _ in range(site.size))

    @property
    def finite_values(self) -> dict[str, range]:
        """The integers of each site that takes finitely many, at most a thousand."""
        known = {name: site.values for name, site in self.sites.items()}
        return {name: values for name, values in known.items() if values is not None and len(values) <= _MAX_VALUES}

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the d coordinates, `level` or `hip_r[0]`."""
        return tuple(name for site in self.sites.values() for name in site.coordinate_names)

    def with_params(self, params: Any) -> CompiledModel:
        """The same model with other params (which may be tracers) of the same structure."""
        return dataclasses.replace(self, params=params, unbound=False)

    def _bound(self) -> Any:
        if self.unbound:
            raise ValueError("The model has a parameters program, and params are not set: use with_params(params).")
        return self.params

    def _arguments(self, inputs: Inputs, x: Array | None = None) -> tuple[Any, ...]:
        """Arguments of a program, at a flat state (d,) if it takes one."""
        check_inputs(self.input_shapes, inputs)
        return self._bound(), *(() if x is None else (bijector.to_sites(self.sites, x),)), inputs

    # Bijectors

    def to_sites(self, x: Array, inputs: Inputs = None) -> dict[str, Array]:
        """Constrained values of the state's sites by name."""
        return bijector.to_sites(self.sites, x)

    def to_flat(self, sites: Mapping[str, Any]) -> Array:
        """The flat state (d,) from constrained values by name."""
        return bijector.to_flat(self.sites, sites)

    def log_det(self, x: Array, inputs: Inputs = None) -> Array:
        """Log-determinant of the bijector, log |d sites / d x|, a scalar."""
        return bijector.log_det(self.sites, x)

    # Draws and log-densities

    def sample_initial(self, rng_key: Array, inputs: Inputs = None) -> Array:
        """Draw the state (d,) at the first frame."""
        self._check_proper()
        return self._draw("initial", rng_key, self._arguments(inputs))

    def log_initial(self, x: Array, inputs: Inputs = None) -> Array:
        """Log-density of the state at the first frame, a scalar."""
        self._check_proper()
        return self._log_density("initial", x, self._arguments(inputs))

    def sample_transition(self, rng_key: Array, x_previous: Array, inputs: Inputs = None) -> Array:
        """Draw the state (d,) at a frame, given the one before it and the inputs of the new frame."""
        return self._draw("transition", rng_key, self._arguments(inputs, x_previous))

    def log_transition(self, x: Array, x_previous: Array, inputs: Inputs = None) -> Array:
        """Log-density of the state `x` given `x_previous`, a scalar."""
        return self._log_density("transition", x, self._arguments(inputs, x_previous))

    def _draw(self, which: str, rng_key: Array, arguments: tuple[Any, ...]) -> Array:
        seed = Seed(rng_key, self.randomness[which])
        trace = trace_program(getattr(self.programs, which), arguments, seed=seed)
        joint = joint_normal(self.sites, trace)
        if joint is None:
            return self.to_flat({name: site["value"] for name, site in sample_sites(trace).items()})
        in_order = list(seed.noise) == list(self.sites)
        noise = seed.normals if in_order else self.to_flat(seed.noise)
        drawn: Array = joint.loc + noise * joint.scale
        return drawn

    def differentiable_draw(self, x: Array, x_previous: Array | None = None, inputs: Inputs = None) -> tuple[Array, Array]:
        """A drawn state (d,), and a log-weight of value 0, which together have the derivative of an expectation of draws.

        Draws of integers, mixtures and rejection samplers do not know what they were drawn by: their log-density provides it,
        as the derivative of the weight (the score; Schulman et al. 2015, arXiv:1506.05254, section 2). Other draws have their
        own.
        """
        program = self.programs.initial if x_previous is None else self.programs.transition
        arguments = self._arguments(inputs, x_previous)
        trace = trace_program(program, arguments, values=bijector.to_sites(self.sites, x))
        without = [name for name in self.sites if not has_derivative(trace[name]["fn"])]
        if not without:
            return x, jnp.zeros((), x.dtype)
        fixed = jnp.asarray([name in without for name, site in self.sites.items() for _ in range(site.size)])
        x = jnp.where(fixed, jax.lax.stop_gradient(x), x)
        trace = trace_program(program, arguments, values=bijector.to_sites(self.sites, x))
        return x, derivative_only(jnp.stack([site_log_density(trace[name], None) for name in without]).sum())

    def _log_density(self, which: str, x: Array, arguments: tuple[Any, ...]) -> Array:
        trace = trace_program(getattr(self.programs, which), arguments, values=bijector.to_sites(self.sites, x))
        joint = joint_normal(self.sites, trace)
        if joint is None:
            return trace_log_density(trace) + bijector.log_det(self.sites, x)
        total: Array = jnp.sum(joint.log_prob(x))
        return total

    def sample_observation(self, rng_key: Array, x: Array, inputs: Inputs = None) -> dict[str, Array]:
        """Draw the data sites of a frame by name; factors draw nothing."""
        arguments = self._arguments(inputs, x)
        return draw(self.programs.observation, arguments, rng_key, self.randomness["observation"])

    def draw_data(self, rng_key: Array, x: Array, inputs: Inputs = None) -> DrawnData:
        """Draw a frame's data (k,) given `x`, in the order of `flat_observation`, and return their moments.

        Raises:
            ValueError: The observation program has a heuristic likelihood, which predicts no data.
        """
        return drawn_data(self.observation_sites, self._drawn_trace(rng_key, x, inputs))

    def why_not_predictive(self, inputs: Inputs = None) -> str | None:
        """Why :meth:`draw_data` cannot be, or None when it can."""
        found: list[str | None] = []

        def look(rng_key: Array, inputs: Inputs) -> None:
            found.append(why_not_predictive(self._drawn_trace(rng_key, jnp.zeros(self.dimension), inputs)))

        jax.eval_shape(look, jax.random.key(0), inputs)
        return found[0]

    def _drawn_trace(self, rng_key: Array, x: Array, inputs: Inputs) -> Any:
        arguments = self._arguments(inputs, x)
        return trace_program(self.programs.observation, arguments, seed=Seed(rng_key, self.randomness["observation"]))

    def log_observation(self, x: Array, observation: Observation, inputs: Inputs = None) -> Array:
        """Log-likelihood of a frame's data, factors included; masked entries add exactly 0."""
        if self.dependent is not None:
            return log_density_of_seen(self.observation_sites, self.dependent, self._data_trace(x, inputs), observation)
        arguments = self._arguments(inputs, x)
        return log_density(self.programs.observation, arguments, observation.values, observation.mask)

    def log_data(self, x: Array, observation: Observation, inputs: Inputs = None) -> dict[str, Array]:
        """Log-likelihood of each event of a frame's data by site, NaN where it is masked; factors are left out.

        That of an event which depends on others of its frame is given those of them that were seen and come before it.
        """
        trace_of = self._data_trace(x, inputs)
        trace = trace_of(observation.values)
        found = {name: masked_event_log_densities(trace[name], mask) for name, mask in observation.mask.items()}
        if self.dependent is not None:
            found |= log_densities_of_events(self.observation_sites, self.dependent, trace_of, observation)
        seen = {name: any_event_mask(mask, trace[name]["fn"]) for name, mask in observation.mask.items()}
        return {name: jnp.where(seen[name], values, jnp.nan) for name, values in found.items()}

    def _data_trace(self, x: Array, inputs: Inputs) -> Callable[[Values], Trace]:
        """Trace of the observation program at `x`, given data."""
        arguments = self._arguments(inputs, x)
        return lambda values: trace_program(self.programs.observation, arguments, values=values)

    def extras(self, x: Array, inputs: Inputs = None) -> dict[str, Array]:
        """The `numpyro.deterministic` sites of the observation program at `x`, by name."""
        arguments = self._arguments(inputs, x)
        trace = trace_program(self.programs.observation, arguments)
        return {name: jnp.asarray(site["value"]) for name, site in trace.items() if site["type"] == "deterministic"}

    def log_joint(
        self, xs: Array, observations: Observation, inputs: Inputs = None, *, data_weight: Array | float = 1.0
    ) -> Array:
        """Log-density of a trajectory and its data, vmapped over time.

        Args:
            xs: Flat states (T, d).
            observations: Stacked data with leading T.
            inputs: Stacked inputs with leading T, or None.
            data_weight: w ().

        Returns:
            log p(x_0) + sum over t >= 1 of log p(x_t | x_t-1) + w sum over t of log p(z_t | x_t), a scalar.
        """
        total = self.log_initial(xs[0], jax.tree.map(lambda a: a[0], inputs))
        total = total + data_weight * jnp.sum(jax.vmap(self.log_observation)(xs, observations, inputs))
        if xs.shape[0] > 1:
            later = jax.tree.map(lambda a: a[1:], inputs)
            total = total + jnp.sum(jax.vmap(self.log_transition)(xs[1:], xs[:-1], later))
        return total

    # Gaussian summaries

    def _check_proper(self) -> None:
        if self.diffuse:
            raise UnsuitableModelError(
                f"Nothing is known of site {self.diffuse[0]!r} at the start (Diffuse), so that it can neither be drawn nor "
                "weighed. Use kalman_filter, which needs no draws, or a Normal in its place."
            )

    def initial_moments(self, inputs: Inputs = None, *, diffuse: bool = False) -> tuple[Array, Array]:
        """Mean (d,) and covariance (d, d) of the first flat state; see :meth:`transition_moments`.

        Args:
            inputs: Inputs of the first frame.
            diffuse: Whether the caller knows that those of `diffuse_coordinates` mean nothing; refused otherwise.
        """
        if not diffuse:
            self._check_proper()
        return self._moments("initial", self._arguments(inputs))

    def initial_is_gaussian(self, inputs: Inputs = None) -> bool:
        """Whether the density of the first flat state is the Gaussian of its moments, where it has these."""
        arguments = self._arguments(inputs)
        values = {name: jnp.zeros(site.shape, site.dtype) for name, site in self.sites.items()}
        gaussian = is_gaussian(trace_program(self.programs.initial, arguments, values=values))
        return gaussian and not self.moments_are_linearised("initial", inputs)

    def transition_moments(self, x_previous: Array, inputs: Inputs = None) -> tuple[Array, Array]:
        """Mean (d,) and covariance (d, d) of the next flat state, from the transition's distributions.

        A site's mean may depend on sites that were sampled before it in the same frame. The moments are exact where it is
        affine in them; where it is not, it is linearised about their mean, and :meth:`moments_are_linearised` is true.

        Raises:
            ValueError: A site has bounds and is no Normal seen through its bijector (as a LogNormal is), takes integers, has no
                moments, or has a scale that depends on a site of its frame.
        """
        return self._moments("transition", self._arguments(inputs, x_previous))

    def moments_are_linearised(self, which: str, inputs: Inputs = None, x_previous: Array | None = None) -> bool:
        """Whether the moments of the "initial" or the "transition" program are linearised within the frame, and not exact."""
        return self._moments_form(which, self._arguments(inputs, x_previous)).linearised

    def same_frame_dependence(self, which: str, inputs: Inputs = None, x_previous: Array | None = None) -> dict[str, list[str]]:
        """For each site of the "initial" or the "transition" program those of its own frame that it depends on."""
        return same_frame_dependence(self.sites, self._trace_of(which, self._arguments(inputs, x_previous)))

    def _moments(self, which: str, arguments: tuple[Any, ...]) -> tuple[Array, Array]:
        form = self._moments_form(which, arguments)
        if form.obstacle is not None:
            raise UnsuitableModelError(
                f"The {which} program has no Gaussian moments: {form.obstacle}. Use an algorithm that only samples it, or "
                "write the site with a Normal, LogNormal or MultivariateNormal of its own."
            )
        return state_moments(self.sites, self._trace_of(which, arguments), form)

    def _moments_form(self, which: str, arguments: tuple[Any, ...]) -> MomentsForm:
        if which not in self._moments_forms:
            self._moments_forms[which] = moments_form(self.sites, self._trace_of(which, arguments))
        return self._moments_forms[which]

    def _trace_of(self, which: str, arguments: tuple[Any, ...]) -> Callable[[Values], Trace]:
        return lambda values: trace_program(getattr(self.programs, which), arguments, values=values)

    @cached_property
    def _moments_forms(self) -> dict[str, MomentsForm]:
        """For each program what the first look at it found."""
        return {}

    def observation_moments(self, x: Array, inputs: Inputs = None) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k) of a frame's data given `x`, in the order of `flat_observation`.

        Raises:
            ValueError: A site that is not Gaussian, or is masked by the program, or a factor.
        """
        if self.dependent is not None:
            return moments_of_data(self.observation_sites, self.dependent, self._data_trace(x, inputs))
        return observation_moments(self.observation_sites, self._feasible_trace(x, inputs))

    def observation_jacobian(self, x: Array, inputs: Inputs = None) -> Array:
        """Derivative (k, d) by `x` of the mean that :meth:`observation_moments` gives."""
        if self.dependent is not None:
            derivative: Array = jax.jacrev(lambda state: self.observation_moments(state, inputs)[0])(x)
            return derivative
        return observation_jacobian(self.observation_sites, lambda state: self._feasible_trace(state, inputs), x)

    def _feasible_trace(self, x: Array, inputs: Inputs) -> Any:
        """Trace of the observation program with some data that it could produce."""
        arguments = self._arguments(inputs, x)
        values = {name: jnp.asarray(feasible(site)) for name, site in self.observation_sites.items()}
        return trace_program(self.programs.observation, arguments, values=values)

    def flat_observation(self, observation: Observation) -> tuple[Array, Array]:
        """Data (k,) of a frame as one vector, and whether each entry was seen (k,)."""
        return flat_observation(self.observation_sites, observation.values, observation.mask)

    def observation_information(
        self,
        x: Array,
        observation: Observation,
        inputs: Inputs = None,
        *,
        majorised: Array | bool = False,
        spread: Array | None = None,
    ) -> Array:
        """Gauss-Newton curvature (d, d) of -log p(z | x) at `x`: symmetric, positive semi-definite.

        If ``majorised``, that of robust errors is of the quadratic that touches their potential from above. With a covariance
        ``spread`` (d, d) of the state about `x`, it is evaluated at the expected size of the errors, not at those of `x`.
        """

        def trace_of(state: Array) -> Any:
            return self._data_trace(state, inputs)(observation.values)

        groups = () if self.dependent is None else self.dependent.gaussian
        left_out = frozenset(name for group in groups for name in group)
        found = observation_information(trace_of, observation.mask, x, majorised=majorised, spread=spread, left_out=left_out)
        for group in groups:
            found = found + information_of_group(
                self.observation_sites, group, lambda state: self._data_trace(state, inputs), x, observation
            )
        return found

    # Static parameters

    def sample_parameters(self, rng_key: Array) -> dict[str, Array]:
        """Draw params from the parameters program.

        Raises:
            ValueError: The model has none.
        """
        return draw(self._parameters_program(), (), rng_key, self.randomness["parameters"])

    def log_parameters(self, params: Mapping[str, Any]) -> Array:
        """Log-density of params (constrained values by name) under the parameters program, a scalar."""
        return log_density(self._parameters_program(), (), params)

    def _parameters_program(self) -> Any:
        if self.programs.parameters is None:
            raise ValueError("The model has no parameters program: give StateSpaceModel(parameters=...).")
        return self.programs.parameters

    # The host boundary

    def observe(
        self, values: Mapping[str, Any] | Observation, mask: Mapping[str, Any] | None = None, frames: int | None = None
    ) -> Observation:
        """Turn arrays with NaN where data are missing into an Observation; see `poseppl.program.observation.observe`.

        An `Observation` is returned unchanged. The logger "poseppl" warns once of each site that float32 rounds; see
        `rounding_notes`.
        """
        if isinstance(values, Observation):
            return values
        observation = observe(self.observation_sites, values, mask, frames)
        if self.dependent is not None:
            check_parents_seen(self.observation_sites, self.dependent, observation.mask)
        self._resolution.warn(observation)
        return observation

    def rounding_notes(self, observation: Observation) -> dict[str, str]:
        """For each data site that float32 rounds too much, a sentence that says so and what to do."""
        return self._resolution.notes(observation)

    @cached_property
    def _resolution(self) -> Resolution:
        unknown = self.unbound or any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(self.params))
        return Resolution(None if unknown else self._feasible_trace, self.dimension, self.input_shapes)

    def unobserved(self) -> Observation:
        """One frame of data of which nothing was seen: everything masked, over safe values."""
        values = {name: jnp.asarray(feasible(site)) for name, site in self.observation_sites.items()}
        return Observation(values, {name: jnp.zeros(value.shape, bool) for name, value in values.items()})
