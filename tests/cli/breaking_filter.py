"""A filter that breaks down at a frame, whatever it is shown."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import pytest

import poseppl.filters
from poseppl.filters import Filter, FilterInfo, ParticleState


def break_down(monkeypatch: pytest.MonkeyPatch, at: int) -> None:
    """Export a filter "breaking" of four chains at the first state's mean, whose state is NaN from frame `at` on."""

    def breaking_filter(model: Any, num_particles: int = 4) -> Filter:
        zero, number = jnp.zeros(()), jnp.int32(0)
        info = FilterInfo(zero, zero, jnp.arange(4, dtype=jnp.int32), zero, number, number, number, jnp.array(False), zero)

        def state(frame: Any, inputs: Any) -> ParticleState:
            particles = jnp.where(frame < at, inputs.start, jnp.nan) * jnp.ones((4, 1))
            return ParticleState(particles, jnp.stack([frame, *[zero] * 3]))  # the frame, as a weight

        def init(rng_key: Any, observation: Any, inputs: Any) -> Any:
            return state(zero, inputs), info

        def step(rng_key: Any, before: Any, observation: Any, inputs: Any) -> Any:
            return state(before.log_weights[0] + 1, inputs), info

        return Filter(init, step)

    monkeypatch.setattr(poseppl.filters, "breaking_filter", breaking_filter, raising=False)
