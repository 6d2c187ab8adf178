r"""Laplace's approximation of a trajectory whose data have autocorrelated errors, which are marginalised instead of followed.

A trajectory x of coordinates that walk (:mod:`poseppl.gaussians.walk_chains`) is seen in pairs of numbers,

    y = location(x) + scale (ratio e + u),     e autoregressive, of variance 1,     u ~ (1 + |u|^2 / nu)^(-nu / 2),

the model that :func:`poseppl.smoothers.laplace.laplace_smoother` treats with e in its state. Here e is eliminated: its best
value, given x, is linear in the residuals, and Newton's system in x alone is

    (F^T F + J^T P J) dx = b,      P = G - ratio^2 G (Q + ratio^2 G)^-1 G      (:mod:`poseppl.gaussians.ar1_errors`).

P couples distant frames, so the system is solved by conjugate gradients. The preconditioner is that of reduced errors: only the
part of e that looks like a step of what is seen is kept, a few coordinates more in each frame (:meth:`View.reduced`). If J, G
and kept are the same in all frames, nothing else of e matters, and one iteration is exact; usually two or three are enough.

The mode is sought with the data's weight growing from next to nothing, so that it does not depend on a bad start. Draws are of
the Gaussian of reduced errors, and standard deviations are its own, without Monte Carlo error. The curvature is taken at
errors as large as they are expected to be, and parameters that do not change keep their prior, as in
:mod:`poseppl.smoothers.laplace`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Booleans, Floats
from poseppl.errors import PosepplError
from poseppl.gaussians.ar1_errors import AR1Errors, ar1_errors, root_of_pairs, times_pairs
from poseppl.gaussians.walk_chains import WalkChains, WalkFactor, ar1_chains, conjugate_gradients, walk_factor

_WEIGHTS = (1e-3, 0.03, 0.2)
"""Weights of the data in the first steps towards the mode."""
_SHORTER, _LONGER = (0.5, 0.2, 0.05, 0.01), (2.0, 4.0, 8.0)
"""Multiples of a step that are tried if it gains less than half of what it promised, and if it gains more."""
_MUCH = 1.3
"""A gain is "more" from this multiple of the promised one."""
_NOTHING = 1e-4
"""Nats a frame that a step has to promise. With less, in a recording of 100 frames the mode is within a seventh of a standard
deviation, all of it in the direction that is known least."""
_NEAR = 1.0
"""With less, steps are by the curvature itself, not by that of a quadratic above the density."""
_STALE = 9
"""Iterations from which on the preconditioner is made again; it costs as much as a dozen."""
_STEP, _RESPONSE = 3e-2, 5e-2
"""Residuals of the solutions for steps, which are corrected by later ones, and for responses."""
_SPREAD_DRAWS = 48
"""Draws that estimate how large errors are expected to be."""
_ROOM = 2**27
"""Bytes of the columns that are solved for together."""


class View(Protocol):
    """Data linearised about a trajectory, in units of the scale of u: J, of T frames."""

    def seen(self, x: Floats) -> Floats:
        """J x (N, M, T, 2) of steps (T, N, n); 0 where a datum is missing."""

    def pulled(self, z: Floats) -> Floats:
        """J^T z (T, N, n)."""

    def reduced(self, weight: Floats, ratio: float) -> tuple[int, Iterable[Floats]]:
        """How many coordinates m reduced errors have, of variance 1, and the information (n + m, n + m) of each frame.

        Args:
            weight: G (M, T, 2, 2).
            ratio: Standard deviation of the autocorrelated errors, in units of the data.
        """

    def reduced_noise(self, weight: Floats, ratio: float, rng: np.random.Generator, count: int) -> Floats:
        """Draws (T, N, n + m) with mean 0, whose covariance is that information of their frame."""


class SeenWalk(NamedTuple):
    """A trajectory of n coordinates over T frames, and M series of pairs that are seen of it.

    Attributes:
        chains: How it walks.
        kept: Part of e that remains from the previous frame (T,).
        ratio: Standard deviation of the autocorrelated errors, in units of the scale of u.
        strength: nu.
        known: Which data are present (M, T).
        residuals: (y - location) / scale of a trajectory (T, n), (M, T, 2), 0 where there are no data.
        view: The data linearised about it.
    """

    chains: WalkChains
    kept: Floats
    ratio: float
    strength: float
    known: Booleans
    residuals: Callable[[Floats], Floats]
    view: Callable[[Floats], View]


class Mode(NamedTuple):
    """A most likely trajectory.

    Attributes:
        x: (T, n).
        errors: e (M, T, 2).
        num_steps: From the start.
    """

    x: Floats
    errors: Floats
    num_steps: int


class Unchanging(NamedTuple):
    """Parameters c (p,) that do not change, with mean 0, and are not learned from the data.

    Attributes:
        root: Lower triangular (p, p), whose square is their covariance.
        seen: Derivatives of the data by each, J_c, (p, M, T, 2) for a slice of them.
    """

    root: Floats
    seen: Callable[[slice], Floats]


class Around(NamedTuple):
    """The Gaussian about a mode.

    Attributes:
        steps: Draws (T, S, n), less the mode; their mean is 0, as the true one.
        unchanging: Draws of c (S, p) that go with them; of many draws mean and covariance are the true ones.
        variance: Variance of x (T, n).
    """

    steps: NDArray[np.float32]
    unchanging: Floats
    variance: Floats


class _Curvature(NamedTuple):
    """A Gaussian model of the density about a trajectory."""

    view: View
    errors: AR1Errors
    chains: WalkChains

    def multiply(self, x: Floats) -> Floats:
        prior = self.chains.pulled(self.chains.innovations(x))
        return np.asarray(prior + self.view.pulled(self.errors.precision(self.view.seen(x))))

    def solve(self, factor: WalkFactor, of_x: Floats, of_e: Floats, tolerance: float) -> tuple[Floats, Floats, int]:
        """Steps of x (T, N, n) and of e (N, M, T, 2) for right-hand sides of their joint system."""
        errors, ratio = self.errors, self.errors.ratio
        right = of_x - ratio * self.view.pulled(errors.weigh(errors.solve(of_e)))
        x, count = conjugate_gradients(self.multiply, factor, right, tolerance)
        return x, errors.solve(of_e - ratio * errors.weigh(self.view.seen(x))), count

    def factor(self, kept: Floats) -> WalkFactor:
        """The system of reduced errors."""
        more, information = self.view.reduced(self.errors.weight, self.errors.ratio)
        return walk_factor(self.chains.beside(ar1_chains(kept, 1.0, more)), information)


def find_mode(problem: SeenWalk, start: Floats, *, most: int = 100, least: float = _NOTHING) -> Mode:
    """Climb to a mode of the trajectory and its errors by Gauss-Newton steps.

    Args:
        problem: The trajectory and its data.
        start: (T, n).
        most: Steps at most.
        least: Nats a frame that a step has to promise, or it is the last.

    Raises:
        PosepplError: The density is not finite.
    """
    x, e = np.asarray(start, np.float64), np.zeros((*problem.known.shape, 2))
    factor, promised, stale = None, np.inf, 0
    for count in range(most):
        weight = _WEIGHTS[count] if count < len(_WEIGHTS) else 1.0
        view, r = problem.view(x), problem.residuals(x)
        slope, curvature = _around_data(problem, r - problem.ratio * e, bent=promised < _NEAR)
        errors = ar1_errors(problem.kept, problem.ratio, weight * curvature)
        model = _Curvature(view, errors, problem.chains)
        if factor is None or stale >= _STALE:
            factor = model.factor(problem.kept)
        off = problem.chains.innovations(x[:, None]) - problem.chains.offset[:, None]
        of_x = view.pulled(weight * slope[None]) - problem.chains.pulled(off)
        of_e = weight * problem.ratio * slope[None] - errors.prior(e[None])
        dx, de, stale = model.solve(factor, of_x, of_e, _STEP)
        promised = 0.5 * float(np.sum(dx * of_x) + np.sum(de * of_e))
        moved = _searched(problem, (x, e), (dx[:, 0], de[0]), weight, promised)
        if not np.isfinite(promised):
            raise PosepplError("the density of the trajectory is not finite")
        if moved is None or (weight == 1 and promised < least * len(x)):
            break
        x, e = moved
    return Mode(x, e, count + 1)


def _searched(
    problem: SeenWalk, here: tuple[Floats, Floats], step: tuple[Floats, Floats], weight: float, promised: float
) -> tuple[Floats, Floats] | None:
    """Result of a step, made shorter or longer according to its gain; None if it gains nothing."""

    def at(length: float) -> tuple[Floats, Floats]:
        return here[0] + length * step[0], here[1] + length * step[1]

    def gain(length: float) -> float:
        return before - _potential(problem, *at(length), weight)

    before, best = _potential(problem, *here, weight), 1.0
    most = gain(best)
    for length in _SHORTER if most < 0.5 * promised else _LONGER if most > _MUCH * promised else ():
        if (own := gain(length)) > most:
            best, most = length, own
        elif most > 0:
            break
    return at(best) if most > 0 else None


def _potential(problem: SeenWalk, x: Floats, e: Floats, weight: float) -> float:
    """Minus the log-density of a trajectory and its errors, and a constant."""
    errors = ar1_chains(problem.kept, 1.0, 1)
    whitened = errors.own * e
    whitened[:, 1:] -= errors.before[1:] * e[:, :-1]
    off = problem.chains.innovations(x[:, None])[:, 0] - problem.chains.offset
    squared = np.square(problem.residuals(x) - problem.ratio * e).sum(-1)
    data = problem.strength * np.log1p(squared[problem.known] / problem.strength).sum()
    found = 0.5 * float(np.sum(off**2) + np.sum(whitened**2) + weight * data)
    return found if np.isfinite(found) else np.inf


def _around_data(problem: SeenWalk, u: Floats, spread: Floats | None = None, *, bent: bool) -> tuple[Floats, Floats]:
    """Minus the gradient of the potential by the location (M, T, 2), and its curvature (M, T, 2, 2), 0 where it is negative.

    Args:
        problem: The trajectory and its data.
        u: Errors that do not last (M, T, 2).
        spread: Covariances of them (M, T, 2, 2): errors are taken to be as large as they are expected to be.
        bent: Whether the curvature is the potential's own; else that of a quadratic above it.
    """
    outer = u[..., :, None] * u[..., None, :] + (0.0 if spread is None else spread)
    first = 1 / (1 + np.trace(outer, axis1=-2, axis2=-1) / problem.strength)
    first = np.where(problem.known, first, 0.0)[..., None]
    curvature = first[..., None] * np.eye(2)
    if bent:
        values, vectors = np.linalg.eigh(curvature - 2 / problem.strength * first[..., None] ** 2 * outer)
        curvature = (vectors * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return first * u, curvature


def gaussian_around(
    problem: SeenWalk, mode: Mode, rng: np.random.Generator, num_draws: int, unchanging: Unchanging | None = None
) -> Around:
    """Draw from Laplace's approximation about a mode.

    Args:
        problem: The trajectory and its data.
        mode: Its mode.
        rng: Random generator of the draws.
        num_draws: S.
        unchanging: Uncertainty of the parameters that do not change; None if they are exact.
    """
    view, u = problem.view(mode.x), problem.residuals(mode.x) - problem.ratio * mode.errors

    def about(spread: Floats | None) -> tuple[_Curvature, WalkFactor]:
        errors = ar1_errors(problem.kept, problem.ratio, _around_data(problem, u, spread, bent=True)[1])
        model = _Curvature(view, errors, problem.chains)
        return model, model.factor(problem.kept)

    model, factor = about(_expected(*about(None), rng))
    steps, done = np.empty((len(mode.x), num_draws, mode.x.shape[1]), np.float32), 0
    for x in _drawn(model, factor, rng, num_draws):
        steps[:, done : done + x.shape[1]] = x
        done += x.shape[1]
    _centre(steps)
    variance = np.empty_like(mode.x)
    for frame, covariance in factor.covariances():
        variance[frame] = np.diagonal(covariance)[: mode.x.shape[1]]
    if unchanging is None:
        return Around(steps, np.zeros((num_draws, 0)), variance)
    drawn = _whitened(rng.standard_normal((num_draws, len(unchanging.root)))) @ unchanging.root.T
    response = _responses(model, factor, unchanging)
    for t in range(len(steps)):
        steps[t] -= drawn @ response[t]
        variance[t] += np.square(response[t].T @ unchanging.root).sum(1)
    return Around(steps, drawn, variance)


def _centre(steps: NDArray[np.float32]) -> None:
    """Take the mean of draws (T, S, n) from them, frame by frame, and keep their variance; of one draw nothing is left."""
    count = steps.shape[1]
    for own in steps if count > 1 else ():
        own -= own.mean(0)
        own *= np.sqrt(count / (count - 1))


def _whitened(draws: Floats) -> Floats:
    """Standard normal draws (S, p), of which many have exactly the right mean and covariance.

    Otherwise an error of a parameter that all frames share would be the same in all frames.
    """
    count, size = draws.shape
    if count <= 2 * size:
        return draws
    centred = draws - draws.mean(0)
    return np.asarray(np.linalg.solve(np.linalg.cholesky(centred.T @ centred / count), centred.T).T, np.float64)


def _expected(model: _Curvature, factor: WalkFactor, rng: np.random.Generator) -> Floats:
    """Covariances (M, T, 2, 2) of the sum of the location and the autocorrelated errors."""
    found, count = np.zeros_like(model.errors.weight), 0
    for x in _drawn(model, factor, rng, _SPREAD_DRAWS):
        off = model.view.seen(x) + model.errors.ratio * _errors_beside(model, rng, x)
        found += np.einsum("nmti,nmtj->mtij", off, off)
        count += len(off)
    return found / count


def _drawn(model: _Curvature, factor: WalkFactor, rng: np.random.Generator, count: int) -> Iterator[Floats]:
    """Draws of x (T, N, n), by parts, with the precision of the factor: the modes of data and prior with noise of their own."""
    for part in _parts(count, model):
        right = model.view.reduced_noise(model.errors.weight, model.errors.ratio, rng, part.stop - part.start)
        noise: Floats = rng.standard_normal(right.shape, np.float32)  # type: ignore[assignment]
        right += factor.chains.pulled(noise)
        yield factor.solve(right)[..., : model.chains.own.shape[1]]


def _errors_beside(model: _Curvature, rng: np.random.Generator, x: Floats) -> Floats:
    """Draws of e (N, M, T, 2), given those of x (T, N, n)."""
    errors, shape = model.errors, (x.shape[1], *model.errors.weight.shape[:-1])
    noise = times_pairs(root_of_pairs(errors.weight), rng.standard_normal(shape))
    right = errors.pulled(rng.standard_normal(shape)) + errors.ratio * noise
    return errors.solve(right - errors.ratio * errors.weigh(model.view.seen(x)))


def _responses(model: _Curvature, factor: WalkFactor, unchanging: Unchanging) -> NDArray[np.float32]:
    """Decrease of the mode (T, p, n) with each parameter that does not change."""
    num_frames, size = model.chains.own.shape
    found = np.empty((num_frames, len(unchanging.root), size), np.float32)
    for part in _parts(len(unchanging.root), model):
        right = model.view.pulled(model.errors.precision(unchanging.seen(part)))
        found[:, part] = conjugate_gradients(model.multiply, factor, right, _RESPONSE)[0]
    return found


def _parts(count: int, model: _Curvature) -> Iterator[slice]:
    """Columns that are solved for together."""
    numbers = 8 * model.chains.own.size + 6 * model.errors.weight.size
    most = max(2, min(count, _ROOM // (8 * numbers)))
    return (slice(first, min(first + most, count)) for first in range(0, count, most))
