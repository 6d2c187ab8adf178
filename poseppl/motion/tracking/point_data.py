"""Image points of a body's markers: the data of most scenes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.motion.bodies.body import Body, BodyInputs
from poseppl.motion.tracking.scene import Scene
from poseppl.motion.tracking.start import seek_start
from poseppl.program import CompiledModel, Observation
from poseppl.runs.run import Constant


class PointData(NamedTuple):
    """Points of K markers in C cameras over T frames; methods as :class:`~poseppl.motion.tracking.scene.SceneData` has them.

    Attributes:
        points: (T, C, K, 2) image points; NaN where a marker was not seen.
        noise: Standard deviation of the points in image units: (C, K), or (T, C, K) where it changes.
        found: Estimates for the cameras before tracking, for the record of a result; plain values.
        faults: Probabilities that detections were wrong, arrays by name: ``wrong_person`` (T, C), that they are another's, and
            ``swaps`` (T, C, P), that limbs of a pair were exchanged before that was put right.
    """

    points: Floats
    noise: Floats
    found: Mapping[str, Any] = {}
    faults: Mapping[str, Floats] = {}

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Those estimates; the scene has the source of its points."""
        return self.found

    def first_frames(self, count: int) -> PointData:
        """The data of the first frames alone."""
        noise = self.noise[:count] if self.noise.ndim == 3 else self.noise
        return self._replace(
            points=self.points[:count], noise=noise, faults={name: values[:count] for name, values in self.faults.items()}
        )

    def seek(self, scene: Scene[PointData], params: Mapping[str, float]) -> Floats:
        """The pose (d,) that explains the best-seen frame."""
        return seek_start(scene.body, scene.cameras, self.points, self.noise)

    def inputs(self, body: Body, walk: Mapping[str, Any]) -> BodyInputs:
        """Inputs of the body's programs."""
        noise = jnp.asarray(self.noise, float)
        varying: Any = noise if noise.ndim == 3 else Constant(noise)
        return BodyInputs(noise=varying, **walk)

    def observe(self, model: CompiledModel) -> Observation:
        """The points as the model's data."""
        return model.observe({"points": self.points})

    def observed(self, body: Body) -> dict[str, NDArray[Any]]:
        """The points as a result tells them."""
        return {"points": self.points}

    def quality(self, scene: Scene[PointData], states: Any) -> dict[str, NDArray[Any]]:
        """Nothing: predictive checks tell how well points agree."""
        return {}
