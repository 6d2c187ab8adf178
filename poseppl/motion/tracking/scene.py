"""A scene: a body, cameras, and what they saw of it over time, with the truth where it is known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, InputError
from poseppl.motion.bodies.body import Body
from poseppl.motion.geometry import Cameras
from poseppl.program import CompiledModel, Observation

MIN_CONFIDENCE = 0.05
"""Points of less confidence count as not seen."""


class SceneData(Protocol):
    """Observations of a body by cameras: points or silhouettes. All that differs between the two is asked here."""

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Attributes of a result that tell of the data, by name."""

    @property
    def faults(self) -> Mapping[str, Floats]:
        """Probabilities (T, ...) that data are wrong, by name."""

    def first_frames(self, count: int) -> Self:
        """The data of the first frames alone."""

    def seek(self, scene: Any, params: Mapping[str, float]) -> Floats:
        """The state (d,) to start from, sought in the scene's data.

        Args:
            scene: The scene that the data are of.
            params: Params of the body's programs.

        Raises:
            InputError: No frame shows enough to start from.
        """

    def inputs(self, body: Body, walk: Mapping[str, Any]) -> Any:
        """The inputs of the body's programs, as :func:`poseppl.runs.run.run_filter` takes them.

        Args:
            body: The body.
            walk: The inputs that do not depend on the data, by name: cameras, start, step scales and tree.
        """

    def observe(self, model: CompiledModel) -> Observation:
        """The data of the body's compiled model."""

    def observed(self, body: Body) -> dict[str, NDArray[Any]]:
        """Arrays of the data that a result keeps, (T, ...) by name; ``points`` (T, C, K, 2) among them."""

    def quality(self, scene: Any, states: Any) -> dict[str, NDArray[Any]]:
        """Figures (T, ...) by name of how well states (T, d) agree with the scene's data."""


Data = TypeVar("Data", bound=SceneData, covariant=True)


class Scene(NamedTuple, Generic[Data]):
    """A body to be tracked, with its cameras and data.

    Attributes:
        body: The body.
        cameras: C cameras.
        camera_names: Their names.
        data: Their observations.
        frames: (T,) frame numbers.
        rate: Frames a second, of frames whose numbers are as far apart as most; None where unknown.
        source: Source.
        states: (T, d) the true states; None where unknown.
        markers: (T, K, 3) mm, true places; None where unknown.
        residual: Mean distance (mm) of the markers from those of the states, where these come from inverse kinematics.
    """

    body: Body
    cameras: Cameras
    camera_names: tuple[str, ...]
    data: Data
    frames: Integers
    rate: float | None
    source: str
    states: Floats | None = None
    markers: Floats | None = None
    residual: float | None = None

    def first_frames(self, count: int) -> Scene[Data]:
        """The first frames alone: what a run that stopped has seen."""
        states, markers = (None if truth is None else truth[:count] for truth in (self.states, self.markers))
        return self._replace(data=self.data.first_frames(count), frames=self.frames[:count], states=states, markers=markers)


def noise_of(body: Body, cameras: Cameras, noise: float | None) -> Floats:
    """Standard deviations (C, K) of image points.

    Args:
        body: The body.
        cameras: C cameras.
        noise: As a fraction of the focal length; the body's own if None.

    Raises:
        InputError: The noise is not positive.
    """
    level = body.noise if noise is None else noise
    if not 0 < level < 10:
        raise InputError(
            f"{level:g}", field=Argument("noise"), expected="a positive fraction of the focal length, such as 0.003"
        )
    scale = np.abs(np.asarray(cameras.focal, np.float64)).mean(-1)
    return np.repeat(level * scale[:, None], len(body.tree.marker_names), axis=1)
