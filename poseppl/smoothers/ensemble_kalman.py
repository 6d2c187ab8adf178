r"""The ensemble Kalman smoother (Evensen and van Leeuwen 2000, doi:10.1175/1520-0493(2000)128<1852:AEKSFN>2.0.CO;2).

The members of the ensemble Kalman filter (:mod:`poseppl.filters.ensemble_kalman`) are trajectories. The data of frame t update
the members at t, and also the same members at every earlier frame s, by the sampled covariance of x_s with y_t,

    x_s,i + C_(x_s, y_t) g_i.

So frame s has seen the data of all frames, or of those up to s + lag. The filter's pass is repeated from the data, because a
history does not contain its members' predictions. On linear Gaussian models it converges to Rauch, Tung and Striebel's answer
with N. The taper is the same for all frames: where what is known moves far in the time of a lag, a shorter lag is safer.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least
from poseppl.filters.ensemble_kalman import EnsembleSettings, EnsembleState, analyse, initial_state
from poseppl.gaussians.ensemble import Form, moved
from poseppl.gaussians.localisation import Localisation
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.smoothers.base import History, Smoothed, Smoother, smoothing_info


@memoized_builder
def ensemble_kalman_smoother(
    model: CompiledModel,
    *,
    num_particles: int = 100,
    lag: int | None = None,
    form: Form = "square-root",
    inflation: float = 1.0,
    adaptive: bool = False,
    relaxation: float = 0.0,
    localisation: Localisation | None = None,
) -> Smoother:
    """The ensemble Kalman smoother: members of the filter, moved at all earlier frames by each frame's data.

    Args:
        model: The compiled model, without finite sites, its observation with Gaussian moments given the state.
        num_particles: N, members of the ensemble, at least 2.
        lag: Later frames whose data a frame takes in, at least 1; all if None.
        form: "square-root", which draws nothing for the data, or "stochastic", with perturbed data.
        inflation: Factor of the prediction's standard deviation, at least 1; where it is adaptive, that of the first frame.
        adaptive: Whether the innovations adapt the inflation.
        relaxation: Share of the spread that the data took which is given back, in [0, 1], at the frame of the data alone.
        localisation: Tapers of sampled covariances, as of :func:`~poseppl.filters.ensemble_kalman.ensemble_kalman_filter`.

    Raises:
        ValueError: A setting out of its range, or tapers that are not for this model.
        UnsuitableModelError: The model has finite sites; or, when the smoother is traced, its observation has no moments.
    """
    settings = EnsembleSettings(num_particles, form, inflation, adaptive, relaxation, localisation).check(model)
    if lag is not None:
        check_at_least(1, lag=lag)

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        num_frames = len(jax.tree.leaves(observations)[0])
        window = num_frames if lag is None else min(lag, num_frames)
        start = initial_state(model, settings)
        taper = None if settings.localisation is None else jnp.asarray(settings.localisation.states, start.particles.dtype)

        def advance(carry: tuple[EnsembleState, Array], row: Any) -> tuple[tuple[EnsembleState, Array], None]:
            (state, members), (key, t, observation, inputs) = carry, row
            state, _, by = analyse(model, settings, key, state, observation, inputs)
            # frames to come are zeros, without deviations, and stay so
            first = jnp.clip(t - window, 0, num_frames - window)
            before = jax.lax.dynamic_slice_in_dim(members, first, window)
            after = jax.vmap(lambda each: moved(each, by, taper))(before)
            members = jax.lax.dynamic_update_slice_in_dim(members, after, first, 0)
            return (state, members.at[t].set(state.particles)), None

        rows = jax.random.split(rng_key, num_frames), jnp.arange(num_frames), observations, inputs
        blank = jnp.zeros((num_frames, *start.particles.shape), start.particles.dtype)
        (_, members), _ = jax.lax.scan(advance, (start, blank), rows)
        log_weights = jnp.broadcast_to(start.log_weights, members.shape[:-1])
        info = smoothing_info(num_frames, jnp.asarray(num_particles), num_transition=float(num_frames * num_particles))
        return Smoothed(members, log_weights, info)

    return Smoother(smooth, joint=True)
