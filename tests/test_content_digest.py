"""Digests by content: equal for what traces to the same program, and for nothing else."""

import enum
import functools
import sys
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
import pytest
from catalogue import FILTERS
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model

import poseppl
from poseppl import content_digest
from poseppl.content_digest import UnknownContent, digest, digest_of_code


@pytest.fixture(autouse=True)
def known(monkeypatch):
    """Functions of this file are as those of poseppl."""
    monkeypatch.setattr(content_digest, "_OWN", ("poseppl", "poseppl_models", __name__))


class Colour(enum.Enum):
    RED, BLUE = 1, 2


class Slotted:
    __slots__ = ("part",)

    def __init__(self, part):
        self.part = part


class Plain:
    def __init__(self, part):
        self.part, self._built = part, object()

    @functools.cached_property
    def twice(self):
        return 2 * self.part

    def method(self):
        return self.part


class Number(float):
    """A number that has attributes, too."""


def closure(a, b=2, *, c=3):
    def function(x, d=b, *, e=c):
        return a + x + d + e

    return function


def with_rule(scale):
    @jax.custom_jvp
    def function(x):
        return x

    function.defjvp(lambda primals, tangents: (primals[0], scale * tangents[0]))
    return function


DISTINCT = {
    "numbers": lambda: [0, 0.0, False, None, "", b"", (), [], {}, -0.0, 1, "1", b"1", (1,), [1], {1: 1}],
    "arrays": lambda: [
        np.zeros(2),
        np.zeros((2, 1)),
        np.zeros(2, np.float32),
        jnp.zeros(2),
        np.ones(2),
        np.float64(0),
        jnp.ones(2),
    ],
    "keys": lambda: [jax.random.key(0), jax.random.key(1), jax.random.key(0, impl="rbg"), jax.random.PRNGKey(0)],
    "orders": lambda: [{"a": 1, "b": 2}, {"b": 2, "a": 1}, ("a", "b"), ("b", "a"), {"a", "b"}, frozenset("ab")],
    "closures": lambda: [
        closure(1),
        closure(2),
        closure(1, 3),
        closure(1, c=4),
        closure(np.ones(2)),
        closure(np.zeros(2)),
        closure,
    ],
    "code": lambda: [lambda x: x + 1, lambda x: x + 2, lambda x: x - 1, lambda x: np.add, lambda x: np.subtract],
    "rules": lambda: [with_rule(1.0), with_rule(2.0)],
    "wrapped": lambda: [
        jax.jit(closure(1)),
        jax.jit(closure(2)),
        functools.cache(closure(1)),
        functools.partial(closure(1), 2),
    ],
    "partial": lambda: [
        functools.partial(max, 1),
        functools.partial(max, 2),
        functools.partial(min, 1),
        functools.partial(max, key=1),
    ],
    "objects": lambda: [Plain(1), Plain(2), Slotted(1), Slotted(2), Plain, Slotted, Plain(1).method, Plain(2).method],
    "enums": lambda: [*Colour, slice(1), slice(2), slice(0, 2), np.dtype("f4"), np.dtype("f8"), range(2), range(3)],
    "library": lambda: [
        np.add,
        np.subtract,
        jnp.add,
        jax.lax.add_p,
        jax.lax.sub_p,
        dist.Normal,
        dist.Cauchy,
        np,
        jnp,
        max,
        min,
    ],
    "distributions": lambda: [
        dist.Normal(0.0, 1.0),
        dist.Normal(0.0, 2.0),
        dist.Normal(0.0, jnp.ones(1)),
        dist.Cauchy(0.0, 1.0),
    ],
    "structures": lambda: [jax.tree.structure(tree) for tree in (1, (1,), [1], {"a": 1}, {"b": 1}, ((1,), 1), (1, (1,)), None)],
    "sharing": lambda: [(a := [1], a), ([1], [1])],
}


@pytest.mark.parametrize("kind", DISTINCT)
def test_different_values_have_different_digests_and_equal_ones_equal(kind):
    digests = [digest(value) for value in DISTINCT[kind]()]
    assert len(set(digests)) == len(digests)
    assert [digest(value) for value in DISTINCT[kind]()] == digests


def test_what_is_computed_from_an_object_does_not_count():
    one, other = Plain(1), Plain(1)
    assert one.twice == 2 and digest(one) == digest(other)


def test_circles_end():
    circle = []
    circle.append(circle)
    assert digest(circle) != digest([])
    deep = functools.reduce(lambda inner, _: [inner], range(10_000), 0)
    with pytest.raises(UnknownContent, match="deep"):
        digest(deep)


def test_what_is_not_known_has_no_digest(monkeypatch):
    module = ModuleType("poseppl.filters.kalman")  # a user's file with one of our names
    exec("def step(x):\n    return x\nclass State:\n    pass", module.__dict__)
    local = type("Local", (), {})
    for value in (module.step, module.State, local(), object(), iter([]), Number(1), [1].append, np.array([None]), sys):
        with pytest.raises(UnknownContent):
            digest(value)
    with pytest.raises(UnknownContent):
        jax.jit(lambda x: digest(x) or x)(1.0)
    monkeypatch.setattr(content_digest, "_OWN", ("poseppl",))
    with pytest.raises(UnknownContent, match=__name__):
        digest(closure(1))


@pytest.mark.parametrize("row", [row for row in FILTERS if row.name in ("particle", "kalman", "hmc")], ids=lambda row: row.name)
def test_filters_of_equal_settings_and_models_are_equal(row):
    def model(**given):
        return linear_gaussian_model(linear_gaussian_matrices(1, **given)).compile()

    assert digest(row.build(model())) == digest(row.build(model())) != digest(row.build(model(Q=[[0.3]])))
    settings = {"kalman": {"linearisation": "unscented"}}.get(row.name, {"num_particles": 7} if row.name == "particle" else {})
    if settings:
        build = {"kalman": poseppl.kalman_filter, "particle": poseppl.particle_filter}[row.name]
        assert digest(build(model())) != digest(build(model(), **settings))


def test_the_code_is_digested_by_its_text(tmp_path, monkeypatch):
    package = tmp_path / "of_tests"
    package.mkdir()
    (package / "__init__.py").write_text("x = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(content_digest, "_OWN", ("of_tests",))

    def now():
        digest_of_code.cache_clear()
        return digest_of_code()

    first = now()
    assert now() == first
    (package / "__init__.py").write_text("x = 2\n")
    second = now()
    (package / "more.py").touch()
    third = now()
    monkeypatch.setenv("XLA_FLAGS", "--xla_other")
    assert len({first, second, third, now()}) == 4
    digest_of_code.cache_clear()
