r"""Simulation-based calibration: do a model and an algorithm find what they were made of?

States (or parameters) and data are drawn from the model, and the algorithm infers them from the data alone. If its draws are
those of the posterior, the truth is one of them like any other: its rank among L draws is uniform on 0..L (Cook, Gelman and
Rubin 2006, doi:10.1198/106186006X136976; Talts et al. 2018, arXiv:1804.06788). Kept are randomised ranks

    u = (rank + U) / (L + 1),    U uniform in (0, 1).

Neighbouring frames have similar ranks, but simulations are independent, so that the test counts simulations: the mean over
the frames of u - 1/2 (is the posterior off to one side?) and of 12 (u - 1/2)^2 - 1 (too narrow, or too wide?) has expectation
0, and a standard error from the spread between simulations. Their t statistics, two for each coordinate, are judged together
(Bonferroni).

>>> rng = np.random.default_rng(0)
>>> right, narrow = (calibration_of(rng.uniform(size=(100, 9, 2)) ** power, ("x", "y")) for power in (1.0, 0.5))
>>> right.chance > 0.05, narrow.chance < 1e-6
(True, True)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import Array
from numpy.typing import ArrayLike
from scipy.special import stdtr

from poseppl.arrays import Floats
from poseppl.checks import check_at_least, check_key
from poseppl.compilation import jit
from poseppl.diagnostics.calibration import randomised_ranks
from poseppl.errors import InputError
from poseppl.filters.base import Filter
from poseppl.program import CompiledModel
from poseppl.runs.batch import infer_batch
from poseppl.runs.collectors import collect_draws
from poseppl.runs.contents import flat_draws
from poseppl.runs.frame_sequence import stacked_inputs
from poseppl.runs.run import Progress
from poseppl.runs.simulation import draw_sequence


class Calibration(NamedTuple):
    """Ranks of the truth, and whether they are uniform.

    Attributes:
        ranks: Randomised ranks (simulation, frame, coordinate), in (0, 1); of parameters one frame.
        names: Names of the coordinates.
        bias: Mean of u - 1/2 by coordinate; positive where the posterior is too low.
        bias_error: Its standard errors.
        excess: Mean of 12 (u - 1/2)^2 - 1 by coordinate; positive where the posterior is too narrow.
        excess_error: Its standard errors.
        chance: Probability of ranks as far from uniform as these, or farther, if the posterior is right.
    """

    ranks: Floats
    names: tuple[str, ...]
    bias: Floats
    bias_error: Floats
    excess: Floats
    excess_error: Floats
    chance: float

    def __str__(self) -> str:
        lines = [
            f"{name}: {bias:+.3f} ± {error:.3f} to one side, {excess:+.2f} ± {spread:.2f} too narrow"
            for name, bias, error, excess, spread in zip(
                self.names, self.bias, self.bias_error, self.excess, self.excess_error, strict=True
            )
        ]
        verdict = "not calibrated" if self.chance < 0.01 else "nothing speaks against calibration"
        return "\n".join([*lines, f"{len(self.ranks)} simulations, chance {self.chance:.2g}: {verdict}"])


def calibrate(
    model: CompiledModel,
    filter: Filter | Callable[[CompiledModel], Filter],
    rng_key: Array,
    *,
    num_frames: int = 20,
    num_simulations: int = 100,
    inputs: Any = None,
    truth: CompiledModel | None = None,
    num_draws: int = 99,
    chunk: int = 100,
    progress: Progress | None = None,
) -> Calibration:
    """Check a filter of a model on data that the model draws.

    Args:
        model: The compiled model.
        filter: Its filter, or the builder.
        rng_key: PRNG key.
        num_frames: Frames T of each simulation.
        num_simulations: Simulations S, at least 20.
        inputs: Inputs with a leading T, the same for all simulations; None where the model takes none.
        truth: The model that draws states and data, with the same sites; the model itself if None. With another one it is asked
            whether a mistake in the model would be noticed.
        num_draws: Draws L that the truth is ranked among.
        chunk: Simulations at a time.
        progress: Called with the number of simulations that are done.

    Returns:
        The ranks of the filtered states, and whether they are uniform.
    """
    check_at_least(1, num_frames=num_frames)
    check_at_least(20, num_simulations=num_simulations)
    check_key(rng_key)
    key_draw, key_infer, key_ties = jax.random.split(rng_key, 3)
    source, rows = model if truth is None else truth, stacked_inputs(inputs, num_frames)
    draw = jit(jax.vmap(lambda keys: draw_sequence(source, keys, rows)))
    states, data = draw(jax.random.split(key_draw, (num_simulations, num_frames, 2)))
    repeated = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (num_simulations, *leaf.shape)), rows)
    collect = collect_draws(model, max_draws=num_draws, extras=_no_extras)
    observed = {name: np.asarray(values) for name, values in data.items()}
    found = infer_batch(model, observed, filter, key_infer, repeated, chunk=chunk, collect=collect, progress=progress)
    draws, ties = flat_draws(found).values, jax.random.uniform(key_ties, states.shape)
    ranks = randomised_ranks(draws.reshape(-1, *draws.shape[2:]), states, ties)
    return calibration_of(ranks, model.coordinate_names)


def calibrate_parameters(
    model: CompiledModel,
    posterior: Callable[[Array, Mapping[str, Array]], Mapping[str, ArrayLike]],
    rng_key: Array,
    *,
    num_frames: int = 20,
    num_simulations: int = 50,
    inputs: Any = None,
    progress: Progress | None = None,
) -> Calibration:
    """Check whether parameters that data were drawn with are recovered.

    Args:
        model: The compiled model, with a parameters program.
        posterior: `(rng_key, data) -> draws by name`, each (L, ...), of the parameters given data by site (T, ...), such as a
            call of particle marginal Metropolis-Hastings; draws should be thinned, for a chain's are alike.
        rng_key: PRNG key.
        num_frames: Frames T of each simulation.
        num_simulations: Simulations S, at least 20.
        inputs: Inputs with a leading T; None where the model takes none.
        progress: Called with the number of simulations that are done.

    Returns:
        The ranks of the parameters, and whether they are uniform.

    Raises:
        InputError: The posterior returns no draws of a parameter, or draws of another shape.
    """
    check_at_least(1, num_frames=num_frames)
    check_at_least(20, num_simulations=num_simulations)
    check_key(rng_key)
    rows = stacked_inputs(inputs, num_frames)
    key_draw, key_infer, key_ties = jax.random.split(rng_key, 3)

    @jit
    @jax.vmap
    def draw(key: Array) -> Any:
        key_parameters, key_data = jax.random.split(key)
        params = model.sample_parameters(key_parameters)
        keys = jax.random.split(key_data, (num_frames, 2))
        return params, draw_sequence(model.with_params(params), keys, rows)[1]

    truths, data = draw(jax.random.split(key_draw, num_simulations))
    rows_of_ranks = []
    for index, key in enumerate(jax.random.split(key_infer, num_simulations)):
        draws = posterior(key, {name: values[index] for name, values in data.items()})
        key_ties, key = jax.random.split(key_ties)
        true = np.concatenate([np.ravel(values[index]) for values in truths.values()])
        flat = [_draws_of(draws, name, values.shape[1:]) for name, values in truths.items()]
        rows_of_ranks.append(randomised_ranks(np.concatenate(flat, 1), true, jax.random.uniform(key, true.shape)))
        if progress:
            progress.advance(1)
    sizes = {name: int(np.prod(values.shape[1:])) for name, values in truths.items()}
    names = [f"{name}[{i}]" if size > 1 else name for name, size in sizes.items() for i in range(size)]
    return calibration_of(np.stack(rows_of_ranks)[:, None], tuple(names))


def _draws_of(draws: Mapping[str, ArrayLike], name: str, shape: tuple[int, ...]) -> Floats:
    """Draws (L, entries) of a parameter of this shape, which a posterior returned."""
    given = np.asarray(draws[name], float) if name in draws else None
    if given is None or not given.ndim or given.shape[1:] != shape or not given.size:
        found = f"draws of {sorted(draws)}" if given is None else f"draws of shape {given.shape}"
        raise InputError(f"the posterior returned {found}", field=name, expected=f"draws {('L', *shape)}, chains put together")
    return given.reshape(len(given), -1)


def calibration_of(ranks: Floats, names: tuple[str, ...]) -> Calibration:
    """Judge ranks (simulation, frame, coordinate); see the module."""
    number = len(ranks)
    centred = ranks.astype(float) - 0.5
    sided, wide = centred.mean(1), (12 * centred**2 - 1).mean(1)
    means, errors = zip(*((part.mean(0), part.std(0, ddof=1) / np.sqrt(number)) for part in (sided, wide)), strict=True)
    statistics = np.abs(np.concatenate(means)) / np.concatenate(errors)
    chance = min(1.0, float(2 * stdtr(number - 1, -statistics.max()) * statistics.size))
    return Calibration(ranks, names, means[0], errors[0], means[1], errors[1], chance)


def _no_extras(x: Array, inputs: Any) -> dict[str, Array]:
    return {}
