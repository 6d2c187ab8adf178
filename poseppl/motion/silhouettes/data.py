"""Silhouettes: the data of scenes seen in videos, or as masks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.motion.bodies.body import Body, BodyInputs
from poseppl.motion.likelihoods import SilhouetteSeen
from poseppl.motion.silhouettes.overlap import SeenSilhouettes, overlap, silhouette_record
from poseppl.motion.silhouettes.start import seek_silhouette
from poseppl.motion.tracking.scene import Scene
from poseppl.program import CompiledModel, Observation
from poseppl.runs.run import Constant


class SilhouetteData(SeenSilhouettes):
    """Silhouettes in C cameras over T frames; methods as :class:`~poseppl.motion.tracking.scene.SceneData` has them."""

    @property
    def provenance(self) -> Mapping[str, Any]:
        """With what settings the silhouettes were found."""
        return {"silhouettes": self.found}

    @property
    def faults(self) -> Mapping[str, Floats]:
        """Nothing: silhouettes that cannot be used are not used."""
        return {}

    def first_frames(self, count: int) -> SilhouetteData:
        """The data of the first frames alone."""
        return self._replace(
            contour=self.contour[:count],
            on_outline=self.on_outline[:count],
            distance=self.distance[:count],
            usable=self.usable[:count],
            person=self.person[:count],
            edges=None if self.edges is None else self.edges[:count],
        )

    def seek(self, scene: Scene[SilhouetteData], params: Mapping[str, float]) -> Floats:
        """The pose (d,) that explains the first frame that most cameras see."""
        return seek_silhouette(scene, params)

    def inputs(self, body: Body, walk: Mapping[str, Any]) -> BodyInputs:
        """Inputs of the body's programs; the noise is that at the place of the start."""
        fixed: Any = Constant
        seen = SilhouetteSeen(
            np.asarray(self.contour, np.float32),  # type: ignore[arg-type]
            self.distance,  # type: ignore[arg-type]
            fixed(jnp.asarray(self.scale, float)),
            self.edges,  # type: ignore[arg-type]
        )
        noise = jnp.asarray(self.noise_in_pixels(walk["cameras"].value, walk["start"].value), float)
        return BodyInputs(seen=seen, noise=fixed(noise), flesh=fixed(body.flesh), **walk)

    def observe(self, model: CompiledModel) -> Observation:
        """Residuals (T, C, entries), all zero; those on the outline count, and all parts where the camera is usable."""
        cameras, entries = model.unobserved().values["silhouette"].shape
        rest = entries - self.on_outline.shape[-1]
        mask = np.concatenate([self.on_outline, np.repeat(self.usable[..., None], rest, 2)], 2)
        return model.observe({"silhouette": np.zeros((len(mask), cameras, entries))}, {"silhouette": mask})

    def observed(self, body: Body) -> dict[str, NDArray[Any]]:
        """Figures of the silhouettes by themselves, as a result tells them; points are all missing."""
        points = np.full((*self.usable.shape, len(body.tree.marker_names), 2), np.nan)
        return {"points": points, **silhouette_record(self)}

    def quality(self, scene: Scene[SilhouetteData], states: Any) -> dict[str, NDArray[Any]]:
        """``overlap`` (T, C) of the states' silhouettes; nothing of a body without flesh or with clamped joints."""
        if scene.body.flesh is None or scene.body.free is not None:
            return {}
        return {"overlap": overlap(scene, states)}
