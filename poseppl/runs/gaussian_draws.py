"""Collector outputs of frames whose posterior is one Gaussian: moments from the compiled program, the rest by NumPy.

If the model has no extras and its sites are the flat state itself, draws and summaries are formulas of a mean and a root of
the covariance. NumPy computes them, so that no program is compiled for them. The noise of frame t depends on the
run's key and on t alone: draws do not depend on how the frames of a run are split.

>>> whole, part = (standard_normals(np.array([1, 2]), start, number, (5, 3)) for start, number in ((0, 4), (2, 2)))
>>> whole.shape, bool((whole[2:] == part).all())
((4, 5, 3), True)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from statistics import NormalDist
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from poseppl.gaussians.gaussian import Gaussian, RootGaussian, semidefinite_root
from poseppl.program import CompiledModel
from poseppl.smoothers.base import GaussianPasses

Floats = NDArray[Any]
_TRAJECTORIES = np.uint32(0x9E3779B9)
"""Turns a key's noise of frames into that of trajectories: a filter and its smoother may have one key."""


class GaussianFrames(NamedTuple):
    """Gaussians of T frames: means (T, d), and lower triangular roots of the covariances (T, d, d)."""

    mean: Any
    root: Any


class Draws(NamedTuple):
    """Draws kept of a frame; of a sequence, with a leading T.

    Attributes:
        state: Draws of the flat state (chains, draws, d).
        sites: Draws of the state's sites by name, as the programs know them, (chains, draws, ...).
        extras: Draws of the extras by name (chains, draws, ...).
        summary: ``state_mean``, ``state_sd``, ``state_quantile`` (quantile, d), and the same of sites and extras, by name; of a
            site of finitely many values ``NAME_probability`` (..., values) instead.
    """

    state: Any
    sites: dict[str, Any]
    extras: dict[str, Any]
    summary: dict[str, Any]


class GaussianCollector(NamedTuple):
    """Collects draws of Gaussian posteriors.

    Attributes:
        model: The model.
        max_draws: Draws of a frame.
        levels: Levels of the quantiles (Q,).
        extras: `(x, inputs) -> values by name`; the collector serves where there are none.
    """

    model: CompiledModel
    max_draws: int
    levels: Floats
    extras: Callable[[Any, Any], Mapping[str, Any]]

    def serves(self, inputs: Any) -> bool:
        """Whether the flat state is all that a result has of this model, given the inputs of one frame or their shapes."""
        plain = all(site.identity and not site.discrete for site in self.model.sites.values())
        return plain and not jax.eval_shape(self.extras, jnp.zeros(self.model.dimension), inputs)

    def keep(self, state: Any, inputs: Any) -> GaussianFrames | None:
        """Output of the compiled program for a frame; None if its posterior is not one Gaussian."""
        posterior = getattr(state, "posterior", None)
        if not isinstance(posterior, Gaussian | RootGaussian) or not self.serves(inputs):
            return None
        root = posterior.scale if isinstance(posterior, RootGaussian) else semidefinite_root(posterior.covariance)
        return GaussianFrames(posterior.mean, root)

    def draw(self, frames: GaussianFrames, key: NDArray[np.uint32], start: int = 0) -> Draws:
        """Independent draws of each frame, and its summary.

        Args:
            frames: The Gaussians of T frames, or of S series of them.
            key: Data of the run's key (2,), or of the keys of the series (S, 2).
            start: The number of the first frame.
        """
        mean, root = np.asarray(frames.mean), np.asarray(frames.root)
        shape = self.max_draws, mean.shape[-1]
        rows = [standard_normals(each, start, mean.shape[-2], shape, mean.dtype) for each in key.reshape(-1, key.shape[-1])]
        noise = np.reshape(rows, (*mean.shape[:-1], *shape))
        draws = mean[..., None, :] + noise @ np.swapaxes(root, -1, -2)
        return self.of_draws(draws, mean, np.sqrt(np.sum(root**2, -1)))

    def draw_backwards(self, rng_key: Array, passes: GaussianPasses, num_draws: int) -> Draws:
        """Trajectories, and the summary of the smoothed Gaussians."""
        arrays: Any = jax.tree.map(np.asarray, passes)
        means, gains = arrays.means, np.swapaxes(arrays.gains, 1, 2)
        noise = standard_normals(key_data(rng_key) ^ _TRAJECTORIES, 0, len(means), (num_draws, means.shape[1]), means.dtype)
        draws = means[:, None] + noise @ np.swapaxes(arrays.roots, 1, 2)
        for t in range(len(means) - 1, 0, -1):
            draws[t - 1] += (draws[t] - arrays.predicted[t]) @ gains[t]
        every = -(-num_draws // self.max_draws)
        mean, root = arrays.smoothed
        return self.of_draws(draws[:, (num_draws - 1) % every :: every], mean, np.sqrt(np.sum(root**2, -1)))

    def of_draws(self, draws: Floats, mean: Floats, deviation: Floats) -> Draws:
        """Draws (..., T, N, d) with the summary of Gaussians of such means and standard deviations (..., T, d)."""
        state = draws[..., None, :, :]
        apart = np.array([NormalDist().inv_cdf(level) if 0 < level < 1 else np.inf * (level - 0.5) for level in self.levels])
        quantile = (mean[..., None, :] + apart[:, None] * deviation[..., None, :]).astype(mean.dtype)
        flat = {"state_mean": mean, "state_sd": deviation, "state_quantile": quantile}
        sites, summary = {}, dict(flat)
        for name, site in self.model.sites.items():
            part = slice(site.offset, site.offset + site.size)
            sites[name] = state[..., part].reshape(*state.shape[:-1], *site.shape)
            if name != "state":
                parts = {f"{name}_{key.removeprefix('state_')}": value[..., part] for key, value in flat.items()}
                summary |= {key: value.reshape(*value.shape[:-1], *site.shape) for key, value in parts.items()}
        return Draws(state, sites, {}, summary)


def key_data(rng_key: Any) -> NDArray[np.uint32]:
    """Data (..., 2) of a key or of several, whatever their generator."""
    return np.asarray(jax.random.key_data(rng_key))[..., :2]


def standard_normals(key: NDArray[Any], start: int, number: int, shape: tuple[int, ...], dtype: Any = np.float32) -> Floats:
    """Standard normal numbers (number, *shape) of the frames from `start` on, by Box and Muller from Philox's counter."""
    size, real = math.prod(shape), np.dtype(dtype)
    words = 4 * -(-size // 8)  # pairs of numbers; the counter counts four words
    philox = np.random.Philox(key=int(key[0]) << 32 | int(key[1]), counter=start * words // 4)
    bits = philox.random_raw(number * words)
    high, low = bits >> np.uint64(32), bits & np.uint64(0xFFFFFFFF)
    uniform = np.maximum(high.astype(real), 0.5) * real.type(2.0**-32)
    radius, angle = np.sqrt(-2 * np.log(uniform)), real.type(2 * np.pi * 2.0**-32) * low.astype(real)
    pairs = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)
    return pairs.reshape(number, -1)[:, :size].reshape(number, *shape)
