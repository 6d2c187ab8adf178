"""Silhouettes: the data of scenes seen in videos, or as masks, and the pose at which tracking starts.

It starts from the pose that explains the silhouettes of the first usable frame best. Least squares on the residuals of
:class:`poseppl.motion.likelihoods.Silhouettes` and on angles relative to the rest pose start from several headings. Their
position is the point that the rays through the middles of the silhouettes meet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy
from jax import Array
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.errors import Argument, InputError, brief
from poseppl.motion.bodies.body import Body, BodyInputs
from poseppl.motion.io.text_parsing import some
from poseppl.motion.likelihoods import SilhouetteSeen
from poseppl.motion.silhouettes.overlap import SeenSilhouettes, overlap, silhouette_record
from poseppl.motion.tracking.scene import Scene
from poseppl.motion.tracking.start import PoseSearch, place_of_points
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


_REST_SPREAD = 0.4
_WIDER = (4.0, 1.0)
"""Factors of the noise, one solution after the other: gross errors, which count no more, are few at first."""
_LATER, _WALKS = 100, 250.0
"""Frames over which, and mm from which on, the way of the person tells where it faces."""
_TOWARDS = 0.5
"""Cosine of the angle up to which a person faces a camera."""
_FRAMES, _EVERY = 4, 10
"""How many frames decide which way the person faces, and how far apart they are."""


def check_facing(name: str, cameras: Sequence[str]) -> None:
    """Check that the camera which the person faces exists.

    Raises:
        InputError: There is none of this name.
    """
    if name not in cameras:
        raise InputError(f"there is no camera {brief(name)}", field=Argument("facing"), expected=some(cameras))


def seek_silhouette(scene: Scene[Any], params: Mapping[str, float]) -> Floats:
    """Find a state (d,) to start from in the first frame that most cameras see.

    Raises:
        InputError: No frame has a silhouette, or no camera has the given name.
    """
    count = scene.data.usable.sum(1)
    if not count.max():
        raise InputError("no frame shows a silhouette", field=Argument("videos"), expected="a person in the picture")
    usable = np.flatnonzero(count == count.max())
    first = int(usable[0])
    search = _Search(scene, params, first)
    candidates = sorted((search.solve(guess, first) for guess in search.guesses()), key=lambda found: found.cost)
    return search.poses.unwound(_turned(search, scene, candidates, usable).state)


def _turned(search: _Search, scene: Scene[Any], candidates: Sequence[_Found], usable: Any) -> _Found:
    """The best of the candidates, sorted by their costs, that is not turned round.

    A silhouette is nearly the same from the front and from the back. If the camera that the person faces is given, the best
    candidate that faces it is taken. Otherwise the best candidate competes with the best one that faces the other way. The one
    that faces the direction of motion wins. For a person who stays in place, the one that explains later frames better wins.
    """
    faced = _faced(scene)
    if faced is not None:
        towards = [search.forward(found.state) @ _unit(faced - found.state[:2]) for found in candidates]
        return candidates[int(np.argmax(np.minimum(towards, _TOWARDS)))]
    away = [found for found in candidates if search.faces_away(found.state, candidates[0].state)]
    rivals = [candidates[0], *away[:1]]
    going = search.way(int(usable[0]), int(usable[min(_LATER, len(usable) - 1)]))
    if np.linalg.norm(going) >= _WALKS:
        return max(rivals, key=lambda found: float(search.forward(found.state) @ going))
    later = [int(frame) for frame in usable[: _FRAMES * _EVERY : _EVERY][1:]]
    return min(rivals, key=lambda found: search.follow(found, later))


def _unit(vector: Floats) -> Floats:
    return vector / max(float(np.linalg.norm(vector)), 1e-9)


def _faced(scene: Scene[Any]) -> Floats | None:
    """Position on the ground (2,) of the camera that the person faces, mm; None where it is not given."""
    name, names = scene.data.facing, scene.camera_names
    if name is None:
        return None
    check_facing(name, names)
    return np.asarray(scene.cameras.centre, np.float64)[names.index(name), :2]


class _Found(NamedTuple):
    cost: float
    state: Floats


class _Search:
    """Least squares on the residuals of one frame after the other."""

    def __init__(self, scene: Scene[Any], params: Mapping[str, float], first: int) -> None:
        self._scene, self.poses = scene, PoseSearch.of(scene.body)
        self._place = _middle(scene, first, self.poses.rest)
        self._evaluate, self._derive = map(jit, _residuals(scene, params, self.poses, self._place))

    def guesses(self) -> Iterator[Floats]:
        """The rest pose at the place of the silhouettes, in every heading."""
        for guess in self.poses.guesses():
            guess[:3] = self._place
            yield guess

    def solve(self, guess: Floats, frame: int) -> _Found:
        """The best pose near a guess."""
        state = guess
        for wider in _WIDER:
            data = _data(self._scene.data, frame)._replace(wider=jnp.asarray(wider, float))
            solution = scipy.optimize.least_squares(
                lambda x, data=data: np.asarray(self._evaluate(x, data), np.float64),
                state,
                jac=lambda x, data=data: np.asarray(self._derive(x, data), np.float64),
                x_scale=self.poses.x_scale,
                ftol=1e-3,
                xtol=1e-4,
                gtol=None,
                max_nfev=40,
            )
            state = np.asarray(solution.x, np.float64)
        return _Found(float(solution.cost), state)

    def follow(self, found: _Found, frames: Sequence[int]) -> float:
        """Sum of the costs of a pose and of what becomes of it."""
        total = found.cost
        for frame in frames:
            found = self.solve(found.state, frame)
            total += found.cost
        return total

    def way(self, first: int, last: int) -> Floats:
        """How far the person goes between two frames on the ground (2,), mm."""
        places = (_middle(self._scene, frame, self.poses.rest) for frame in (last, first))
        return np.asarray(next(places) - next(places))[:2]

    def forward(self, state: Floats) -> Floats:
        """Direction (2,) that a state faces: along y, turned by its heading."""
        heading = float(state[self.poses.headings].sum())
        return np.array([-np.sin(heading), np.cos(heading)])

    def faces_away(self, state: Floats, other: Floats) -> bool:
        """Whether the headings of two states differ by more than a right angle."""
        headings = self.poses.headings
        return bool(np.any(np.cos(state[headings] - other[headings]) < 0))


class _Data(NamedTuple):
    """Observed silhouettes of a frame, which contour points (C, K) and cameras (C,) count, and the noise by its factor."""

    seen: SilhouetteSeen
    on_outline: Array
    usable: Array
    wider: Array


def _data(seen: SeenSilhouettes, frame: int) -> _Data:
    contour, distance, scale = (jnp.asarray(each, float) for each in (seen.contour[frame], seen.distance[frame], seen.scale))
    on_outline, usable = (jnp.asarray(each[frame], float) for each in (seen.on_outline, seen.usable))
    edges = None if seen.edges is None else jnp.asarray(seen.edges[frame], float)
    return _Data(SilhouetteSeen(contour, distance, scale, edges), on_outline, usable, jnp.ones(()))


def _middle(scene: Scene[Any], frame: int, rest: Floats) -> Floats:
    """Guess the root's position (3,): the silhouettes' points are taken for markers spread over the body."""
    body, seen = scene.body, scene.data
    names = body.tree.marker_names
    points = np.full((len(seen.usable[0]), len(names), 2), np.nan)
    for camera in np.flatnonzero(seen.usable[frame]):
        contour = seen.contour[frame, camera]
        low, high = contour.min(0), contour.max(0)
        # the box of the silhouette, seen as the box of the markers
        spread = np.linspace(0.0, 1.0, len(names))[:, None]
        points[camera] = np.where([False, True], low + spread * (high - low), (low + high) / 2)
    return place_of_points(body, scene.cameras, points, rest)


def _residuals(
    scene: Scene[Any], params: Mapping[str, float], poses: PoseSearch, place: Floats
) -> tuple[Callable[..., Array], Callable[..., Array]]:
    """Residuals of a state and the data of a frame, and their derivatives by the state."""
    body, cameras = scene.body, scene.cameras
    guess = np.concatenate([place, poses.rest[3:]])
    noise = jnp.asarray(scene.data.noise_in_pixels(cameras, guess), float)

    def inputs(data: _Data) -> BodyInputs:
        walk = jnp.asarray(guess, float), *2 * (jnp.ones(len(guess)),)
        return BodyInputs(cameras, noise * data.wider, *walk, body.tree, seen=data.seen, flesh=body.flesh)

    model = body.compile(inputs(_data(scene.data, 0)), params)

    def weights(data: _Data, count: int) -> Array:
        """Weights of all residuals: of the outline first, then of parts that stick out."""
        beyond = jnp.broadcast_to(data.usable[:, None], (len(noise), count // len(noise) - data.on_outline.shape[1]))
        return (jnp.concatenate([data.on_outline, beyond], 1) / (noise * data.wider)[:, None]).ravel()

    def residuals(x: Array, data: _Data) -> Array:
        distances = model.observation_moments(x, inputs(data))[0]
        apart = jnp.where(poses.free, (x - poses.rest) / _REST_SPREAD, 0.0)
        return jnp.concatenate([distances * weights(data, len(distances)), apart])

    def derivatives(x: Array, data: _Data) -> Array:
        jacobian = model.observation_jacobian(x, inputs(data))
        apart = jnp.diag(jnp.where(poses.free, 1 / _REST_SPREAD, 0.0))
        return jnp.concatenate([jacobian * weights(data, len(jacobian))[:, None], apart])

    return residuals, derivatives
