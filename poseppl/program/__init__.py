"""State-space models written as NumPyro programs, compiled into pure single-particle samplers and log-densities.

A model is three programs: the state's sites at the first frame, the same sites at t given the state at t - 1, and the data
given the state. Compiled, the state is one flat unconstrained vector x (d,), and every algorithm sees only

    log p(x_0),   log p(x_t | x_t-1),   log p(z_t | x_t),   and draws from each.

Time convention: `inputs[t]` is what is known at frame t. It is used by the transition into t, from t - 1 to t, and by the
observation at t; `inputs[0]` by the initial program and the observation at 0.

Example:
    >>> import numpyro, jax.numpy as jnp
    >>> import numpyro.distributions as dist
    >>> def initial(params, inputs):
    ...     numpyro.sample("level", dist.Normal(0.0, 1.0))
    >>> def transition(params, state, inputs):
    ...     numpyro.sample("level", dist.Normal(state["level"], 0.5))
    >>> def observation(params, state, inputs):
    ...     numpyro.sample("height", dist.Normal(state["level"], 1.0))
    >>> model = StateSpaceModel(initial, transition, observation).compile()
    >>> model.coordinate_names
    ('level',)
    >>> data = model.observe({"height": [0.3, float("nan")]})
    >>> data.mask["height"].tolist()
    [True, False]
    >>> round(float(model.log_joint(jnp.array([[0.0], [0.5]]), data)), 3)
    -2.609
"""

from poseppl.program.bijector import Site as Site
from poseppl.program.bounded import Bounded as Bounded, bounded as bounded
from poseppl.program.clamped import Clamped as Clamped, ClampedModel as ClampedModel, clamp as clamp
from poseppl.program.closed_forms import (
    SummedDensity as SummedDensity,
    WhitenedJacobian as WhitenedJacobian,
    check_closed_forms as check_closed_forms,
)
from poseppl.program.cluttered_errors import Cluttered as Cluttered
from poseppl.program.compiled import CompiledModel as CompiledModel
from poseppl.program.diffuse import Diffuse as Diffuse
from poseppl.program.diffusion import euler_maruyama as euler_maruyama, milstein as milstein
from poseppl.program.model import StateSpaceModel as StateSpaceModel
from poseppl.program.observation import Observation as Observation
from poseppl.program.proposal import Proposal as Proposal
from poseppl.program.robust_errors import Leclerc as Leclerc, Lorentzian as Lorentzian, RobustError as RobustError
from poseppl.program.substeps import with_reset as with_reset, with_substeps as with_substeps
