"""Speed of the published image likelihoods: evaluations a second with 3 cameras of 640 x 480.

    python -m benchmarks.image_likelihoods             10,000 particles
    python -m benchmarks.image_likelihoods --quick     a tiny number, to see that it runs

Peursum, Venkatesh and West (2010, section 7.3) needed 240 s a frame for 10,000 particles.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.bodies.cone_body import ConeBody
from poseppl_models.darby.body import darby_body, darby_monocular_score, darby_score
from poseppl_models.du_guan.evidence import du_guan_evidence, pad_bins, part_colours
from poseppl_models.du_guan.likelihood import du_guan_body, du_guan_score
from poseppl_models.images.evidence import two_way_evidence
from poseppl_models.images.image_program import ImageInputs, camera_likelihood
from poseppl_models.images.silhouette_bits import body_bits, unpack_bits
from poseppl_models.peursum.body import peursum_body, peursum_score, smooth_peursum_score

from benchmarks.timing import arguments, interleave, show
from poseppl.motion.geometry import Cameras, join_cameras, look_at
from poseppl.motion.geometry.flesh import parts_of

PARAMS = {"lambda": 10.0, "beta": 10.0, "gamma": 5.0, "overlap_scale": 1.0, "colour_scale": 0.3, "boundary_scale": 0.3}
STRIDE = 4


def cameras() -> Cameras:
    views = []
    for angle in 2 * np.pi * np.arange(3) / 3:
        view = look_at((3500 * np.sin(angle), -3500 * np.cos(angle), 1200), (0, 0, 900), 600.0)
        views.append(view._replace(principal=jnp.array([[319.5, 239.5]])))
    return join_cameras(views)


def silhouettes(body: ConeBody, view: Cameras) -> np.ndarray:
    @jax.jit
    def bits(*arguments: Any) -> jax.Array:
        cameras, tree, flesh, state = jax.tree.map(lambda leaf: leaf[..., None], arguments)
        return body_bits(cameras, flesh, parts_of(tree, flesh, state), 480, 20, 1)[..., 0]

    return unpack_bits(np.asarray(bits(view, body.tree, body.flesh, jnp.asarray(body.rest, float))), 640)


def two_way(body: ConeBody, view: Cameras) -> Any:
    mask = silhouettes(body, view)
    edges = mask & ~(np.roll(mask, 2, 1) & np.roll(mask, -2, 1) & np.roll(mask, 2, 2) & np.roll(mask, -2, 2))
    return two_way_evidence(mask, edges, np.ones_like(mask), stride=STRIDE)


def colours(body: ConeBody, view: Cameras) -> Any:
    mask = silhouettes(body, view)
    bins = np.where(mask, np.arange(480)[:, None] // 20, 100)
    known = np.ones_like(mask)
    sought = part_colours(body, body.rest, view, pad_bins(bins, known), 110)
    return du_guan_evidence(mask, known, bins, sought, np.ones(sought.shape[:2]), stride=STRIDE)


def main() -> None:
    options = arguments(__doc__, particles=10_000, repetitions=7)
    count = 100 if options.quick else options.particles
    view = cameras()
    cases = {
        "Peursum": (peursum_body(), peursum_score(STRIDE), two_way),
        "Peursum, smooth": (peursum_body(), smooth_peursum_score(), two_way),
        "Darby, Eq. 8": (darby_body(), darby_score(), two_way),
        "Darby, Eq. 8, smooth": (darby_body(), darby_score(smooth=True), two_way),
        "Darby, Eq. 9": (darby_body(), darby_monocular_score(STRIDE), two_way),
        "Du and Guan": (du_guan_body(), du_guan_score(STRIDE), colours),
    }
    rivals = {}
    for name, (body, score, images) in cases.items():
        spread = np.where(np.arange(body.tree.dimension) < 3, 50.0, 0.2)
        states = jnp.asarray(body.rest + spread * np.random.default_rng(0).normal(size=(count, len(spread))), float)
        frame = ImageInputs(view, jnp.ones(3), images(body, view), *[jnp.asarray(body.rest, float)] * 3)
        likelihood = camera_likelihood(body, score)
        compiled = jax.jit(lambda states, frame, f=likelihood: jax.vmap(lambda x: f(PARAMS, x, frame))(states))
        rivals[name] = lambda f=compiled, s=states, i=frame: f(s, i)
    found = interleave(rivals, 1 if options.quick else options.repetitions)
    rows = [[name, f"{t.first:.1f}", f"{t.median:.3f}", f"{count / t.median:,.0f}"] for name, t in found.items()]
    show(
        f"{count:,} particles, 3 cameras of 640 x 480", ("likelihood", "first (s)", "median (s)", "evaluations a second"), rows
    )


if __name__ == "__main__":
    main()
