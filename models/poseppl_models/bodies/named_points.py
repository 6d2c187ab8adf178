r"""Named points in space, seen by a detector in calibrated cameras: a fly's legs, a hand, a mouse, a board.

Position p (K, 3), velocity v and, for each camera and point, what is wrong with the detector's idea of it:

    dp = v dt,    dv = -v / tau dt + speed sqrt(2 / tau) dW       a stationary velocity, so that gaps stay bounded
    e_t ~ N(b e_(t-1), 1 - b^2),    b = exp(-dt / lasts)          (C, K, 2)    errors that last some time
    d_t = d_0 ~ N(0, 1)                                           (C, K, 2)    a bias that stays
    m_t = project(p_t) + scale (lasting e_t + bias d_t)
    y_t ~ (1 - pi_t) Student-t(m_t, other_t) + pi_t Uniform(picture)

Motion and autocorrelated errors are processes in continuous time, in seconds, whose transitions are exact: frames without data,
or more frames a second, change nothing (:func:`motion_transition`).

A scale belongs to a point, not to a camera: a detector errs by so many mm at the point, which a camera of longer lens shows
larger; ``log_size`` is that of all points, ``log_scale`` says by how much one point is worse than the others, ``camera`` by how
much one camera is: that of a camera without data is predicted by its prior. With the logit of the detector's
confidence, l, and log scale the sum of the three,

    log other_t = log scale + slope (l_t - l_0),      logit pi_t = clutter + clutter_slope (l_t - l_0),   l_0 = 3;

autocorrelated errors are ``exp(log_lasting)`` times the scale, biases ``exp(log_bias)`` times these.

Links between points say that their distance stays near a length, which is unknown and constant. The data of the site ``links``
are zeros, an observation of distance minus length, whose standard deviation is the tolerance. Units of length are those of a
pixel at the points, whatever the file's are (:mod:`poseppl.motion.points.named_points`); the site ``motion`` (K, 3, 2) has
positions and velocities.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Any

import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
from jax import Array

from poseppl.motion.bodies.body import PointInputs
from poseppl.motion.geometry import project
from poseppl.program import Cluttered, StateSpaceModel

CONFIDENCE = 3.0
"""l_0, the logit of a confidence of 0.95."""
CAMERA_SCALE = 0.3
"""Prior standard deviation of ``camera``; ours."""
DRIFT = 0.005
"""Step of what is constant in a second, in its own standard deviations: 0.04 of one in a minute."""
_SHORT = 0.02
"""Times in units of tau below which the variance of a place is a series: there the closed form cancels."""


def noise_scales(params: Mapping[str, Array], magnification: Array, logit: Array) -> tuple[Array, Array, Array]:
    """Scales (C, K), px, of the autocorrelated errors, the bias and the other errors, these with leading axes of ``logit``."""
    size = jnp.exp(params["log_size"] + params["log_scale"] + params["camera"][:, None]) * magnification[:, None]
    other, lasting = size * jnp.exp(params["slope"] * (logit - CONFIDENCE)), size * jnp.exp(params["log_lasting"])
    return lasting, lasting * jnp.exp(params["log_bias"]), other


def clutter_log_odds(params: Mapping[str, Array], logit: Array) -> Array:
    """Log-odds that a point of this confidence is clutter."""
    return params["clutter"] + params["clutter_slope"] * (logit - CONFIDENCE)


def parameters(num_points: int, num_cameras: int) -> dict[str, Array]:
    """The prior over what does not change; lengths are in pixels at the points, times in seconds."""
    about = partial(_about, (num_points,))
    return {
        "log_size": _about((), "log_size", 1.0, 1.0),
        "log_scale": about("log_scale", 0.0, 0.5),
        "log_speed": about("log_speed", 4.0, 1.5),
        "log_speed_lasts": _about((), "log_speed_lasts", -0.5, 1.0),
        "camera": _about((num_cameras,), "camera", 0.0, CAMERA_SCALE),
        "slope": _about((), "slope", -0.15, 0.1),
        "clutter": _about((), "clutter", -5.0, 1.0),
        "clutter_slope": _about((), "clutter_slope", -0.7, 0.2),
        "log_lasting": _about((), "log_lasting", 0.0, 1.0),
        "log_bias": _about((), "log_bias", -0.7, 0.7),
        "log_lasts": _about((), "log_lasts", -0.7, 0.7),
    }


def _about(shape: tuple[int, ...], name: str, mean: float, scale: float) -> Array:
    value: Array = numpyro.sample(name, dist.Normal(jnp.full(shape, mean), scale))
    return value


def motion_transition(elapsed: Array, tau: Array) -> tuple[Array, Array]:
    """Matrix (2, 2) of the mean of a place and its velocity, and Cholesky factor (2, 2) of their covariance at speed 1.

    With h = elapsed / tau the place has the variance tau^2 (2 h - 3 + 4 exp(-h) - exp(-2 h)) (Uhlenbeck and Ornstein 1930,
    doi:10.1103/PhysRev.36.823).
    """
    h = elapsed / tau
    kept, gone = jnp.exp(-h), -jnp.expm1(-h)
    long = 2 * h - 2 * gone - gone**2
    short = h**3 * (2 / 3 - h / 2 + 7 / 30 * h**2 - h**3 / 12 + 31 / 1260 * h**4)
    place = tau * jnp.sqrt(jnp.where(h < _SHORT, short, long))
    beside = tau * gone**2 / place
    rest = jnp.sqrt(-jnp.expm1(-2 * h) - beside**2)
    one, nothing = jnp.ones_like(kept), jnp.zeros_like(kept)
    mean = jnp.stack([jnp.stack([one, tau * gone]), jnp.stack([nothing, kept])])
    return mean, jnp.stack([jnp.stack([place, nothing]), jnp.stack([beside, rest])])


@lru_cache(maxsize=16)
def points_in_cameras(num_points: int, num_cameras: int, links: tuple[tuple[int, int], ...] = ()) -> StateSpaceModel:
    """Write the programs; their data are ``points`` (C, K, 2), px, and zeros ``links`` (L,) where there are links.

    Args:
        num_points: K.
        num_cameras: C.
        links: Pairs of points.
    """
    errors = (num_cameras, num_points, 2)
    ends = tuple(jnp.asarray([pair[end] for pair in links], int) for end in (0, 1)) if links else None

    def initial(params: Any, inputs: PointInputs) -> None:
        speed = jnp.broadcast_to(jnp.exp(params["log_speed"])[:, None], (num_points, 3))
        apart = jnp.stack([jnp.broadcast_to(inputs.start_scale, speed.shape), speed], -1)
        mean = jnp.stack([inputs.start, jnp.zeros_like(inputs.start)], -1)
        numpyro.sample("motion", dist.MultivariateNormal(mean, scale_tril=apart[..., None] * jnp.eye(2)))
        numpyro.sample("error", dist.Normal(jnp.zeros(errors), 1.0))
        numpyro.sample("bias", dist.Normal(jnp.zeros(errors), 1.0))
        if links:
            numpyro.sample("length", dist.Normal(inputs.length, inputs.length_scale))

    def transition(params: Any, state: Mapping[str, Any], inputs: PointInputs) -> None:
        drift = DRIFT * jnp.sqrt(inputs.elapsed)
        mean, lower = motion_transition(inputs.elapsed, jnp.exp(params["log_speed_lasts"]))
        lower = jnp.exp(params["log_speed"])[:, None, None, None] * lower
        numpyro.sample("motion", dist.MultivariateNormal(state["motion"] @ mean.T, scale_tril=lower))
        kept = jnp.exp(-inputs.elapsed * jnp.exp(-params["log_lasts"]))
        numpyro.sample("error", dist.Normal(kept * state["error"], jnp.sqrt(1 - kept**2)))
        numpyro.sample("bias", dist.Normal(state["bias"], drift))
        if links:
            numpyro.sample("length", dist.Normal(state["length"], drift * inputs.tolerance))

    def observation(params: Any, state: Mapping[str, Any], inputs: PointInputs) -> None:
        lasting, bias, other = noise_scales(params, inputs.magnification, inputs.logit)
        wrong = lasting[..., None] * state["error"] + bias[..., None] * state["bias"]
        seen = project(inputs.cameras, state["motion"][..., 0]) + wrong
        odds = clutter_log_odds(params, inputs.logit)
        errors = dist.Normal(seen, other[..., None]).to_event(1)
        numpyro.sample("points", Cluttered(errors, inputs.freedom, odds, inputs.window[:, None]))
        for name, value in (("seen", seen), ("scale", other), ("log_odds", odds)):
            numpyro.deterministic(name, value)
        if ends is not None:
            first, second = (state["motion"][end, :, 0] for end in ends)
            apart = jnp.sqrt(jnp.sum((first - second) ** 2, -1) + 1e-12)
            numpyro.sample("links", dist.Normal(apart - state["length"], inputs.tolerance))

    prior: Callable[[], Any] = partial(parameters, num_points, num_cameras)
    return StateSpaceModel(initial, transition, observation, prior)
