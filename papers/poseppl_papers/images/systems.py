"""Published systems on scenes: named, built, and given what the cameras show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

from jax import Array
from poseppl_models.images.image_systems import ImageSystem, build_system

from poseppl.arrays import Floats
from poseppl.filters import Filter
from poseppl.program import CompiledModel
from poseppl.runs.algorithms import FILTERS
from poseppl_papers.images.scenes import Scene, see

Settings = tuple[tuple[str, Any], ...]
"""Names and plain values."""
LIMBS = "limbs"
"""In place of a filter's groups of coordinates: those of the system's arms and legs."""


@dataclass(frozen=True)
class System:
    """A published system.

    Attributes:
        name: Name in tables.
        builder: ``package.module:builder``, as :func:`poseppl_models.images.image_systems.build_system` takes it.
        views: How many cameras it uses, the first ones.
        settings: Settings of the builder.
    """

    name: str
    builder: str
    views: int
    settings: Settings = ()

    def with_settings(self, **settings: Any) -> System:
        """The same with other settings."""
        return System(self.name, self.builder, self.views, tuple(sorted({**dict(self.settings), **settings}.items())))


@dataclass(frozen=True)
class Method:
    """A filter as a paper has it.

    Attributes:
        name: Name in tables.
        filter: Its name in the library.
        settings: Its settings; :data:`LIMBS` stands for the system's limbs.
    """

    name: str
    filter: str
    settings: Settings

    def build(self, problem: Problem) -> Filter:
        """Build it for a problem."""
        limbs = problem.system.limbs
        settings = {name: limbs if value == LIMBS else value for name, value in self.settings}
        built: Filter = FILTERS[self.filter].builder(problem.model, **settings)
        return built


class Problem(NamedTuple):
    """A system before a scene of T frames.

    Attributes:
        system: The system.
        model: Its model, compiled.
        frames: Inputs of each frame.
        truth: The fifteen virtual markers (T, 15, 3), mm.
    """

    system: ImageSystem
    model: CompiledModel
    frames: Sequence[Any]
    truth: Floats

    def first(self) -> Array:
        """The state before frame 0, where somebody tells it."""
        learned, inputs = self.system.learned, self.frames[0]
        if learned is None:
            return inputs.start  # type: ignore[no-any-return]
        assert learned.first is not None
        return learned.first(inputs)

    def poses(self, states: Array, frame: int) -> Array:
        """Poses (N, d) of states."""
        learned = self.system.learned
        return states if learned is None else learned.poses(states, self.frames[frame])


@lru_cache(maxsize=2)
def problem_of(scene: Scene, system: System, num_frames: int) -> Problem:
    """Put a system before the first frames of a scene.

    Raises:
        InputError: The scene cannot be seen, or there is no such builder.
    """
    seen = see(scene)
    built = build_system(system.builder, seen.person(), {"views": system.views, **dict(system.settings)})
    frames = [built.inputs(sight) for sight in seen.sights(num_frames, system.views)]
    return Problem(built, built.program.compile(frames[0], built.params), frames, seen.truth[:num_frames])
