"""How programs are compiled: without what takes long where they are small, and as they are where XLA knows no options."""

import jax
import pytest

from poseppl import compilation


class Lowered:
    """Keeps the options that it is compiled with; knows no others than `known`."""

    def __init__(self, *known: str) -> None:
        self.known, self.options = known, {}

    def compile(self, compiler_options: dict[str, int] | None = None) -> str:
        options = compiler_options or {}
        if not set(options) <= set(self.known):
            raise jax.errors.JaxRuntimeError("No such compile option")
        self.options = options
        return "compiled"


EMITTERS, LEVEL = "xla_cpu_use_fusion_emitters", "xla_backend_optimization_level"


pytestmark = pytest.mark.usefixtures("optimised")


def test_no_level_is_above_what_jax_is_configured_for() -> None:
    jax.config.update("jax_disable_most_optimizations", True)
    lowered = Lowered(EMITTERS, LEVEL)
    compilation.compile_lowered(lowered, 10, 10)
    assert lowered.options == {EMITTERS: False}


@pytest.mark.parametrize(
    ("known", "numbers", "options"),
    [
        ((EMITTERS,), (10_000, 10_000), {EMITTERS: False}),
        ((EMITTERS,), (10_001, 10_001), {}),
        ((EMITTERS, LEVEL), (1000, 1000), {EMITTERS: False, LEVEL: 1}),
        ((EMITTERS, LEVEL), (1000, 1001), {EMITTERS: False}),
        ((), (1000, 1000), {}),
    ],
)
def test_few_particles_leave_the_emitters_out_and_few_numbers_optimisation(
    known: tuple[str, ...], numbers: tuple[int, int], options: dict[str, int]
) -> None:
    lowered = Lowered(*known)
    assert compilation.compile_lowered(lowered, *numbers) == "compiled"
    assert lowered.options == options


@pytest.mark.parametrize(
    ("numbers", "options"),
    [
        ((1000, 1000), {EMITTERS: False, LEVEL: 0}),
        ((1000, 1001), {EMITTERS: False, LEVEL: 1}),
        ((10_001, 10_001), {LEVEL: 1}),
    ],
)
def test_what_runs_once_is_hardly_optimised(numbers: tuple[int, int], options: dict[str, int]) -> None:
    lowered = Lowered(EMITTERS, LEVEL)
    assert compilation.compile_to_run_once(lowered, *numbers) == "compiled"
    assert lowered.options == options


@pytest.mark.parametrize(
    ("numbers", "closed_form", "options"),
    [
        ((1000, 1001), False, {EMITTERS: False}),
        ((1000, 1000), False, {EMITTERS: False, LEVEL: 1}),
        ((1001, 1001), False, {}),
        ((1000, 1001), True, {EMITTERS: False, LEVEL: 1}),
        ((1001, 1001), True, {LEVEL: 1}),
    ],
)
def test_smoothers_of_more_than_a_thousand_keep_the_emitters_and_formulas_are_hardly_optimised(
    numbers: tuple[int, int], closed_form: bool, options: dict[str, int]
) -> None:
    lowered = Lowered(EMITTERS, LEVEL)
    assert compilation.compile_smoother(lowered, *numbers, closed_form) == "compiled"
    assert lowered.options == options


@pytest.mark.full
def test_a_gpu_compiles_as_it_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    lowered = Lowered(EMITTERS, LEVEL)
    assert compilation.compile_to_run_once(lowered, 10, 10) == "compiled" and lowered.options == {}
