"""Errors of the compiler: each message has the site, what was found, what was expected and the remedy."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from numpyro import handlers
from programs import initial, model, observation, transition


def refused(match, inputs=None, params=None, **programs):
    with pytest.raises(ValueError, match=match):
        model(**programs).compile(inputs, params)


def states(*sites):
    """A transition (or initial) program with exactly these (name, distribution) sites."""

    def program(*arguments):
        for name, distribution in sites:
            numpyro.sample(name, distribution)

    return program


NORMAL = dist.Normal(0.0, 1.0)
PAIR = dist.Normal(0.0, 1.0).expand([2])


def test_missing_site():
    refused("does not sample the state site 'slope'.*samples \\['level'\\]", transition=states(("level", NORMAL)))


def test_extra_site():
    program = states(("level", NORMAL), ("slope", PAIR), ("drift", NORMAL))
    refused("samples 'drift', which the initial program does not. Expected exactly", transition=program)


def test_misspelt_site():
    program = states(("levle", NORMAL), ("slope", PAIR))
    refused("samples 'levle'.*did you mean 'level'", transition=program)


def test_misspelt_state():
    def program(params, state, inputs):
        numpyro.sample("height", dist.Normal(state["lvel"], 1.0))

    refused("observation program looks up 'lvel'.*did you mean 'level'", observation=program)


@pytest.mark.parametrize("shape", [(), (1,), (3,), (2, 1)])
def test_other_shape(shape):
    program = states(("level", NORMAL), ("slope", dist.Normal(0.0, 1.0).expand(shape)))
    refused("'slope' has shape .* in the transition program and \\(2,\\)", transition=program)


def test_other_dtype_kind():
    program = states(("level", dist.Poisson(2.0)), ("slope", PAIR))
    refused("'level' is integer .* float32", transition=program)


def test_other_support():
    program = states(("level", dist.HalfNormal(1.0)), ("slope", PAIR))
    refused("'level' has support Positive.* in the transition program and Real", transition=program)


@pytest.mark.full
def test_same_support_said_differently():
    first = states(("a", dist.HalfNormal(1.0)), ("b", dist.Uniform(0.0, 1.0).expand([2])), ("c", dist.VonMises(0.0, 1.0)))
    one = ("a", dist.TruncatedNormal(0.0, 1.0, low=0.0))
    two = ("b", dist.Uniform(jnp.zeros(2), jnp.ones(2)).to_event(1))
    compiled = model(first, states(one, two, ("c", NORMAL)), states(("y", NORMAL))).compile()
    assert list(compiled.sites) == ["a", "b", "c"]


@pytest.mark.parametrize("source", ["state", "params", "inputs", "site"])
def test_support_that_moves(source):
    def program(params, state, inputs):
        level = numpyro.sample("level", NORMAL)
        bound = {
            "state": lambda: jnp.abs(state["level"]),
            "params": lambda: params,
            "inputs": lambda: inputs,
            "site": lambda: level,
        }
        numpyro.sample("slope", dist.Uniform(-1.0, bound[source]()).expand([2]))

    refused("support of site 'slope' in the transition program depends", 1.0, jnp.float32(1.0), transition=program)


def test_support_from_constants_is_fixed():
    def first(params, inputs):
        numpyro.sample("level", dist.Uniform(jnp.zeros(2) - 1, jnp.linspace(1, 2, 2)))

    site = model(first, lambda p, s, i: first(p, i), states(("y", NORMAL))).compile().sites["level"]
    np.testing.assert_allclose(site.support.upper_bound, [1, 2])


def test_bounds_of_supports_are_one_program():
    """Operation by operation they would each be compiled by themselves."""
    compiled = []

    def tell(name, seconds, fun_name="", **told):
        if name.endswith("backend_compile_duration"):
            compiled.append(fun_name)

    def first(params, inputs):
        low = jnp.cos(inputs["scale"] * np.arange(77.0))  # of a shape that nothing else has compiled for
        numpyro.sample("level", dist.Uniform(-2.0 - low**2, jnp.tanh(low) + 2.0))

    built = model(first, lambda p, s, i: first(p, i), states(("y", NORMAL)))
    jax.monitoring.register_event_duration_secs_listener(tell)
    with pytest.raises(ValueError, match="level"):  # its bounds depend on inputs, which is known when they have been computed
        built.compile({"scale": 1.0})
    found = [*compiled]
    assert {"jit(run)"} <= set(found) and not {"jit(cos)", "jit(tanh)"} & set(found), found


@pytest.mark.parametrize("which", ["initial", "transition", "observation"])
def test_obs_left_in(which):
    def program(*arguments):
        numpyro.sample("level", NORMAL, obs=0.3)
        numpyro.sample("slope", PAIR)

    refused(f"'level' in the {which} program was given obs=", **{which: program})


@pytest.mark.parametrize("which", ["initial", "transition"])
def test_factor_in_a_state_program(which):
    def program(*arguments):
        states(("level", NORMAL), ("slope", PAIR))()
        numpyro.factor("prior", -1.0)

    refused(f"{which} program has a numpyro.factor site 'prior'.*belong in the observation", **{which: program})


@pytest.mark.parametrize("which", ["initial", "transition"])
@pytest.mark.parametrize("handler", [handlers.scale(scale=2.0), handlers.mask(mask=jnp.array(False))])
def test_scale_or_mask_in_a_state_program(which, handler):
    def program(*arguments):
        with handler:
            numpyro.sample("level", NORMAL)
        numpyro.sample("slope", PAIR)

    refused(f"{which} program scales or masks the density of site 'level'.*belong in the observation", **{which: program})


def test_a_plate_is_no_scale():
    def program(*arguments):
        with numpyro.plate("all", 2):
            numpyro.sample("slope", NORMAL)
        numpyro.sample("level", NORMAL)

    assert model(initial=program, transition=program).compile().coordinate_names == ("slope[0]", "slope[1]", "level")


def test_name_used_twice():
    refused("initial program.*unique names.*`level`.*own name", initial=states(("level", NORMAL), ("level", NORMAL)))


def test_param_site():
    def program(params, state, inputs):
        numpyro.sample("height", dist.Normal(numpyro.param("offset", 0.0), 1.0))

    refused("numpyro.param site 'offset'", observation=program)


def test_programs_without_sites():
    refused("initial program has no sample site", initial=lambda params, inputs: None)
    refused("neither a sample site nor a numpyro.factor", observation=lambda params, state, inputs: None)


def test_complex_site():
    class Phase(dist.Normal):
        def sample(self, key, sample_shape=()):
            return super().sample(key, sample_shape) + 0j

    refused("'phase' is complex", initial=states(("phase", Phase(0.0, 1.0))))


def test_only_shapes_of_inputs_count():
    def program(params, state, inputs):
        numpyro.sample("height", dist.Normal(state["level"] * inputs["gain"], 1.0))

    for inputs in ({"gain": 2}, {"gain": np.float32(2)}, {"gain": jax.ShapeDtypeStruct((), jnp.float32)}):
        assert model(observation=program).compile(inputs).dimension == 3


def test_params_may_hold_what_is_no_array():
    def program(params, state, inputs):
        numpyro.sample("height", dist.Normal(0.0, params["noise"]).expand([params["count"]]))

    compiled = model(observation=program).compile(params={"noise": 0.5, "count": 3})
    assert compiled.observation_sites["height"].shape == (3,)


def test_compiles_inside_jit():
    @jax.jit
    def density(noise):
        def program(params, state, inputs):
            numpyro.sample("height", dist.HalfNormal(params))

        return model(observation=program).compile(params=noise).log_initial(jnp.zeros(3))

    assert np.isfinite(density(1.0))


@pytest.mark.full
def test_the_programs_of_these_tests_compile():
    compiled = model(initial, transition, observation).compile()
    assert compiled.coordinate_names == ("level", "slope[0]", "slope[1]")
    assert compiled.randomness == {"initial": (0, 3), "transition": (0, 3), "observation": (0, 1)}
