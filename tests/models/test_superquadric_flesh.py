"""A body of superquadrics beside one of cones: the same silhouette, nearly."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.choo_fleet import full_body
from poseppl_models.choo_fleet_flesh import choo_fleet_flesh
from poseppl_models.superquadric_flesh import superquadric_flesh

from poseppl.motion.geometry import join_cameras, look_at
from poseppl.motion.geometry.coverage import hard_coverage, part_distances, project_parts
from poseppl.motion.geometry.flesh import flesh_of, parts_of
from poseppl.motion.geometry.kinematics import frames_of
from poseppl.motion.geometry.superquadric_outlines import outlines_of, superquadric_distances
from poseppl.motion.geometry.superquadrics import superquadrics_of


def last(tree):
    return jax.tree.map(lambda leaf: jnp.asarray(leaf)[..., None], tree)


@pytest.mark.slow
def test_silhouettes_overlap_those_of_cones_at_random_poses():
    """IoU over 0.88 in both cameras, where hands are missing and ends differ; a body a quarter thinner is further away."""
    body, rng = full_body(), np.random.default_rng(0)
    tree, cones = body.tree, flesh_of(body.tree, choo_fleet_flesh(body.lengths))
    views = [look_at(place, (0.0, 0.0, 900.0), 400.0) for place in ((0.0, -4000.0, 1500.0), (3500.0, 500.0, 1200.0))]
    grid = np.stack(np.meshgrid(np.linspace(-140, 140, 110), np.linspace(-140, 140, 110)), -1).reshape(1, -1, 2, 1)
    points, cameras = jnp.asarray(grid.repeat(2, 0), float), last(join_cameras(views))

    @jax.jit
    def by_cones(state):
        return hard_coverage(
            part_distances(project_parts(cameras, last(cones), parts_of(last(tree), last(cones), state)), points)
        )

    @jax.jit
    def by_superquadrics(flesh, state):
        outlines = outlines_of(cameras, last(flesh), frames_of(last(tree), state))
        return hard_coverage(superquadric_distances(outlines, points))

    def overlaps(flesh, state):
        one, other = np.asarray(by_cones(state)), np.asarray(by_superquadrics(flesh, state))
        return np.sum(one & other, (1, 2)) / np.sum(one | other, (1, 2))

    flesh, thin = (superquadrics_of(tree, superquadric_flesh(body.lengths, girth=girth)) for girth in (1.0, 0.75))
    assert len(flesh.names) == 16
    found, thinner = [], []
    for _ in range(4):
        state = np.array(body.rest)
        state[3:] += rng.normal(0, 0.4, len(state) - 3)
        state = jnp.asarray(state, float)[:, None]
        found.append(overlaps(flesh, state))
        thinner.append(overlaps(thin, state))
    assert np.min(found) > 0.88, found
    assert np.max(thinner) < np.min(found), (found, thinner)
