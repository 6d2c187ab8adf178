"""One filter over several devices: particles, or chains, are shared out evenly among them.

Before and after every step, the arrays of the filter's state with one row per particle are placed in equal parts on the devices
of a mesh. XLA's partitioner divides the work accordingly: each device moves and weighs its own particles, and devices
communicate where a sum or a resampling needs all particles. So any filter runs on any number of devices, with the same result
to rounding: the draws are the same, but sums may be added in another order. Work without a row for each particle, such as a
climb to a mode, is done on every device.

    sharded(particle_filter(model, 100_000), 4)

Several devices pay where each has processors of its own. A CPU that is made into several is good for trying it out, and no
faster. It also needs more threads (:mod:`poseppl.threads`): eight a device are plenty. ``poseppl track --set devices=N`` sees
to it; in Python, call ``poseppl.threads.spare_threads(devices)`` before JAX starts.

In float32 a difference in the last digit can turn a resampling or an acceptance the other way, in HMC on the 28-D body within a
few frames; from there on the run is another one of the same law.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jax import Array
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec

from poseppl.filters.base import Filter, FilterInfo
from poseppl.program.memoized_builder import memoized_builder

_AXIS = "particles"


@memoized_builder
def sharded(filter: Filter, devices: int | Sequence[jax.Device]) -> Filter:
    """Share a filter's particles or chains among devices.

    Args:
        filter: The filter; its number of particles, or of chains, is a multiple of the number of devices.
        devices: How many, the first of JAX's default kind; or which.

    Returns:
        The filter on these devices. Its step accepts states from anywhere.

    Raises:
        ValueError: There are not so many devices, or, when the filter is first called, its particles cannot be shared evenly.
    """
    chosen = _find_devices(devices)
    spec: Any = PartitionSpec  # untyped in JAX, as the next one is
    constrain: Any = jax.lax.with_sharding_constraint
    mesh = Mesh(np.array(chosen), (_AXIS,), axis_types=(AxisType.Auto,))

    def shardings(state: Any) -> Any:
        number = state.particles.shape[0]
        if number % len(chosen):
            raise ValueError(f"{number} particles or chains cannot be shared evenly among {len(chosen)} devices")

        def of(leaf: Any) -> NamedSharding:
            rows = leaf.ndim > 0 and leaf.shape[0] == number
            return NamedSharding(mesh, spec(_AXIS) if rows else spec())

        return jax.tree.map(of, state)

    def kept(state: Any) -> Any:
        return constrain(state, shardings(state))

    def init(rng_key: Array, observation: Any, inputs: Any = None) -> tuple[Any, FilterInfo]:
        state, info = filter.init(rng_key, observation, inputs)
        return kept(state), info

    def step(rng_key: Array, state: Any, observation: Any, inputs: Any = None) -> tuple[Any, FilterInfo]:
        state, info = filter.step(rng_key, kept(state), observation, inputs)
        return kept(state), info

    def to_devices(state: Any) -> Any:
        return jax.device_put(state, shardings(state))

    return dataclasses.replace(filter, init=init, step=step, to_devices=to_devices)


def _find_devices(devices: int | Sequence[jax.Device]) -> list[jax.Device]:
    if not isinstance(devices, int):
        if not devices:
            raise ValueError("devices is empty. Expected at least one device.")
        return list(devices)
    present = jax.devices()
    if not 1 <= devices <= len(present):
        raise ValueError(
            f"devices is {devices}, but JAX has {len(present)} here ({present[0].platform}). Expected 1 to {len(present)}; "
            f"a CPU is made into several by XLA_FLAGS=--xla_force_host_platform_device_count={max(devices, 1)}"
        )
    return present[:devices]
