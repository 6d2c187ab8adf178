"""A start of which nothing is known: a site of the initial program without a prior."""

from __future__ import annotations

from typing import Any

import numpyro.distributions as dist


class Diffuse(dist.Normal):  # type: ignore[misc]
    """A flat prior on the line, for sites of the initial program alone.

    A Kalman filter and its smoother take the exact limit of a Normal whose variance goes to infinity
    (:mod:`poseppl.gaussians.diffuse`). There are no draws of it: other algorithms refuse the model.

    Args:
        loc: Point of linearisation for programs that are not linear, while the state is still unknown.
    """

    def __init__(self, loc: Any = 0.0, *, validate_args: bool | None = None) -> None:
        super().__init__(loc, 1.0, validate_args=validate_args)
