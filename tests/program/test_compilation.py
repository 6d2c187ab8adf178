"""How programs are compiled: without fusion emitters for few particles, as it is for many, and where XLA knows none."""

import jax
import pytest

from poseppl.program import compilation


class Lowered:
    """Keeps the options that it is compiled with; knows no others than `known`."""

    def __init__(self, *known: str) -> None:
        self.known, self.options = known, []

    def compile(self, compiler_options: dict[str, bool] | None = None) -> str:
        options = tuple(compiler_options or ())
        if not set(options) <= set(self.known):
            raise jax.errors.JaxRuntimeError("No such compile option")
        self.options = options
        return "compiled"


@pytest.mark.parametrize(
    ("known", "num_particles", "options"),
    [
        (("xla_cpu_use_fusion_emitters",), 1000, ("xla_cpu_use_fusion_emitters",)),
        (("xla_cpu_use_fusion_emitters",), 1001, ()),
        ((), 1000, ()),
    ],
)
def test_few_particles_leave_the_emitters_out(known: tuple[str, ...], num_particles: int, options: tuple[str, ...]) -> None:
    lowered = Lowered(*known)
    assert compilation.compile_lowered(lowered, num_particles) == "compiled"
    assert lowered.options == options
