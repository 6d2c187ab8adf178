"""Filters and smoothers by name, and their settings: all from exports, signatures and docstrings."""

from __future__ import annotations

from collections import Counter
from inspect import Parameter, signature
from typing import Any, Literal, NamedTuple, get_args

import pytest

import poseppl.filters
import poseppl.smoothers
from poseppl.cli import main
from poseppl.declarations import declared
from poseppl.errors import InputError, SettingError
from poseppl.filters import Filter, particle_filter
from poseppl.kernels import HMCSettings
from poseppl.particles.resampling import Scheme
from poseppl.program import CompiledModel
from poseppl.runs.algorithms import FILTERS, SMOOTHERS, Algorithm
from poseppl.runs.settings import arguments_of, settings_of, summary_of

ALGORITHMS: list[Algorithm] = [*FILTERS.values(), *SMOOTHERS.values()]
every_algorithm = pytest.mark.parametrize("algorithm", ALGORITHMS, ids=lambda algorithm: f"{algorithm.kind}-{algorithm.name}")


def test_the_exports_are_the_algorithms():
    for kind, package, known in ("filter", poseppl.filters, FILTERS), ("smoother", poseppl.smoothers, SMOOTHERS):
        exported = {name for name in vars(package) if name.endswith(f"_{kind}") and callable(getattr(package, name))}
        assert len(exported) > 10 and exported == {algorithm.builder.__name__ for algorithm in known.values()}
    assert FILTERS["hidden-markov"].builder is poseppl.filters.hidden_markov_filter
    assert SMOOTHERS["rauch-tung-striebel"].builder is poseppl.smoothers.rauch_tung_striebel_smoother
    with pytest.raises(InputError, match=r"'kalmann' is no filter \(expected kalman\)"):
        FILTERS["kalmann"]
    with pytest.raises(InputError, match="no smoother.*backward-simulation, ensemble-kalman, fixed-lag"):
        SMOOTHERS["xyz"]


@every_algorithm
def test_settings_are_declared_as_they_are(algorithm: Algorithm):
    """Read from the source without importing it, or from the builder."""
    kind, builder = algorithm.kind, algorithm.builder
    seen = settings_of(declared(f"poseppl.{kind}s", builder.__name__))
    assert list(seen.items()) == list(settings_of(builder).items())
    assert summary_of(declared(builder.__module__, builder.__name__)) == summary_of(builder)


@every_algorithm
def test_what_is_listed_is_reported_by_a_sentence_and_may_be_left_out(algorithm: Algorithm):
    """Every argument but the model has a default, and every setting a sentence; no name stands for two fields."""
    assert algorithm.summary.endswith(".") and len(algorithm.summary) > 20
    parameters = list(signature(algorithm.builder).parameters.values())
    assert parameters[0].name == "model" and all(p.default is not Parameter.empty for p in parameters[1:])
    fields = [field for p in parameters for field in getattr(p.default, "_fields", ())]
    assert max(Counter(fields).values(), default=1) == 1
    for setting in algorithm.settings.values():
        assert setting.text.endswith(".") and ":`" not in setting.text, setting.name
        assert setting.read(setting.default) == setting.default
        assert setting.read(str(setting.default)) == setting.default


@pytest.mark.full
@every_algorithm
def test_no_number_below_zero_and_no_other_type_is_taken(algorithm: Algorithm):
    for name, setting in algorithm.settings.items():
        for value in [-1] * (setting.kind in (int, float)) + ["nan", "perhaps"]:
            with pytest.raises(SettingError, match=f"^{name}={value!r}(\\.0)?: expected ") as caught:
                algorithm.check({name: value})
            assert "\n" not in str(caught.value)


CASES: list[tuple[str, dict[str, Any], str]] = [
    ("hmc", {"num_chains": 0}, "num_chains=0: expected at least 1"),
    ("hmc", {"num_chains": 2.0}, "num_chains=2.0: expected a whole number"),
    ("hmc", {"num_chains": True}, "num_chains=True: expected a whole number"),
    ("hmc", {"num_chains": None}, "num_chains=None: expected a whole number"),
    ("hmc", {"num_chains": 2**31}, "expected a whole number"),
    ("hmc", {"num_updates": 4, "num_warmup": "4"}, "num_warmup=4: expected 0 to num_updates - 1 = 3"),
    ("hmc", {"step_size": float("inf")}, "step_size=inf: expected a number"),
    ("hmc", {"dense_mass": "yes"}, "dense_mass='yes': expected true or false"),
    ("hmc", {"target_acceptance": "much"}, "target_acceptance='much': expected a number, or none"),
    (
        "hmc",
        {"draws": 10},
        "draws=10: no setting of the filter hmc .expected num_chains, num_updates, num_leapfrog, num_warmup",
    ),
    ("hmc", {"updates": 10}, "no setting of the filter hmc .expected num_updates.$"),
    ("hmc", {"curvature": 10}, "no setting of the filter hmc"),
    ("particle", {"ess_threshold": 1.5}, r"ess_threshold=1.5: expected a number in \[0, 1\]"),
    ("particle", {"resampling": "none"}, "expected one of systematic, stratified, residual, multinomial"),
    ("tempered", {"chain_length": 3}, "chain_length=3: expected a divisor of num_particles = 500"),
    ("hidden-markov", {"num_chains": 3}, r"\(expected schedule\)"),
]


@pytest.mark.parametrize(("name", "settings", "told"), CASES)
def test_what_cannot_be_used_is_reported_by_the_arguments_name(name: str, settings: dict[str, Any], told: str):
    with pytest.raises(SettingError, match=told):
        FILTERS[name].check(settings)


def test_an_algorithm_without_settings_says_so():
    with pytest.raises(SettingError, match=r"\(expected no settings\)"):
        SMOOTHERS["genealogy"].check({"num_chains": 3})


def test_words_are_read_by_the_annotations():
    given = {"num_chains": "1_000", "step_size": "1e-1", "dense_mass": "True", "target_acceptance": "none", "jitter": 0}
    read = FILTERS["hmc"].complete(given)
    assert read["num_chains"] == 1000 and read["step_size"] == 0.1
    assert read["dense_mass"] is True and read["target_acceptance"] is None and read["jitter"] == 0.0
    assert read["num_updates"] == HMCSettings().num_updates
    assert SMOOTHERS["gibbs"].complete({"correction": "none"})["correction"] == "none"
    assert [setting.kind for setting in settings_of(particle_filter).values()] == [int, Scheme, float]


SMALL_STEPS = HMCSettings(step_size=0.3)


class Inner(NamedTuple):
    """Settings.

    Attributes:
        shared: The field's.
        choice: One of :class:`~poseppl.cli.main` or ``two``,
            over two lines.
        array: For Python alone.
    """

    shared: int = 3
    choice: Literal["one", "two"] = "one"
    array: Any = None


def example(model: Any, shared: int = 1, inner: Inner | None = None, *, other: CompiledModel | None = None) -> None:
    """The first sentence. The second.

    Args:
        model: The model.
        shared: The argument's.
        inner: Fields.
        other: For Python alone.
    """


def test_fields_go_by_their_names_and_after_arguments():
    settings = settings_of(example)
    assert list(settings) == ["shared", "choice"]
    assert (settings["shared"].default, settings["shared"].text) == (1, "The argument's.")
    assert settings["choice"].text == "One of main or ``two``, over two lines."
    assert settings["choice"].shown == "choice: one|two = one" and get_args(settings["choice"].kind) == ("one", "two")
    assert arguments_of(example, {"shared": 5, "choice": "two"}) == {"shared": 5, "inner": Inner(choice="two")}
    assert Algorithm("filter", "example", example).summary == "The first sentence."


def test_settings_come_to_the_algorithm(monkeypatch: pytest.MonkeyPatch):
    """An exported builder is on the command line, with its settings."""
    seen = {}

    def toy_filter(model: CompiledModel, num_particles: int = 7, settings: HMCSettings = SMALL_STEPS) -> Filter:
        """A toy."""
        seen.update(num_particles=num_particles, settings=settings)
        return particle_filter(model, num_particles)

    monkeypatch.setattr(poseppl.filters, "toy_filter", toy_filter, raising=False)
    FILTERS["toy"].check({"num_particles": "9", "num_updates": "40", "jitter": "0.25"})
    assert seen == {"num_particles": 9, "settings": SMALL_STEPS._replace(num_updates=40, jitter=0.25)}


@pytest.mark.full
def test_the_lists_tell_every_algorithm_and_every_setting(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setenv("COLUMNS", "200")
    for kind, algorithms in (("filters", FILTERS), ("smoothers", SMOOTHERS)):
        assert main([kind]) == 0
        text = " ".join(capsys.readouterr().out.split())
        for name, algorithm in algorithms.items():
            assert f"{name}: {algorithm.summary}" in text
            assert all(setting.shown in text for setting in algorithm.settings.values())
            assert main([kind, name]) == 0
            one = " ".join(capsys.readouterr().out.split())
            assert one.startswith(f"{name}: {algorithm.summary}")
            assert all(f"{setting.shown} {setting.text}" in one for setting in algorithm.settings.values())
