"""Positions of the flesh of a body at the mean states of a result: the group ``flesh``, which the report draws."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from poseppl.compilation import jit
from poseppl.motion.geometry.flesh import part_frames
from poseppl.motion.tracking.problem import Problem


def with_flesh(tree: xr.DataTree, problem: Problem) -> xr.DataTree:
    """Add the group ``flesh`` to a result of a body whose silhouette is known; other results stay as they are.

    Args:
        tree: The result.
        problem: The problem that it solves.

    Returns:
        The result with ``base``, ``tip`` and ``side`` (frame, part, axis): both ends of each part's axis in mm, and the
        direction of its own x; and ``radii`` (part, end) in mm, ``scales`` (part, across), ``balls`` (part), as in
        :class:`poseppl.motion.geometry.flesh.Flesh`. No group where joints were clamped to a truth, which a result does not
        hold, or where the state is not the pose.
    """
    body, flesh, means = problem.body, problem.body.flesh, tree["summary"].dataset["state_mean"]
    if flesh is None or problem.pose is not None or means.sizes["state_dim"] != body.tree.dimension:
        return tree
    places = jit(jax.vmap(lambda state: part_frames(body.tree, flesh, state)))(jnp.asarray(means.values, float))
    moving = {"base": places.base, "tip": places.tip, "side": places.axes[..., 0]}
    found = {name: (("frame", "part", "axis"), np.asarray(values, np.float32)) for name, values in moving.items()}
    sizes = {
        "radii": (("part", "end"), flesh.radii),
        "scales": (("part", "across"), flesh.scales),
        "balls": ("part", flesh.balls),
    }
    fixed = {name: (dims, np.asarray(values, np.float32)) for name, (dims, values) in sizes.items()}
    return tree.assign({"flesh": xr.DataTree(xr.Dataset({**found, **fixed}, {"part": list(flesh.names)}))})
