"""A process of its own, with four devices: filters on one of them and on all, compared; prints JSON.

python sharding_report.py NAME...    rows of the catalogue
python sharding_report.py driver     a whole run, saved and resumed
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS), str(TESTS / "laws")]

import jax  # noqa: E402
import numpy as np  # noqa: E402
from catalogue import FILTERS  # noqa: E402
from law_problems import Problem, problem  # noqa: E402

from poseppl.filters import Filter, particle_filter, sharded  # noqa: E402
from poseppl.runs.checkpoint import Checkpoint  # noqa: E402
from poseppl.runs.run import run_filter  # noqa: E402

NUM_FRAMES = 4


def go(filter_: Filter, posed: Problem) -> tuple[list, list, list, float]:
    """States, evidences, where the particles are, and the transcendental functions of a step, on each device."""
    keys = jax.random.split(jax.random.key(3), NUM_FRAMES)
    data = [posed.at(t) for t in range(NUM_FRAMES)]
    state, info = jax.jit(filter_.init)(keys[0], *data[0])
    step = jax.jit(filter_.step).lower(keys[1], state, *data[1]).compile()
    states, infos = [state], [info]
    for key, seen in zip(keys[1:], data[1:], strict=True):
        state, info = step(key, states[-1], *seen)
        states.append(state)
        infos.append(info)
    places = [[str(shard.index[0]) for shard in state.particles.addressable_shards] for state in states]
    return states, [info.log_evidence for info in infos], places, step.cost_analysis()["transcendentals"]


def compare(name: str, posed: Problem) -> dict:
    """One row of the catalogue on one device and on four."""
    built = next(row for row in FILTERS if row.name == name).build(posed.model)
    one, four = go(built, posed), go(sharded(built, 4), posed)
    other = go(built, posed._replace(observations=jax.tree.map(_rounded_otherwise, posed.observations)))[0]

    def distance(a, b):
        return max(float(np.max(np.abs(np.asarray(x) - np.asarray(y)), initial=0.0)) for x, y in zip(a, b, strict=True))

    return {
        "dtype": str(four[0][0].particles.dtype),
        "particles": distance([state.particles for state in one[0]], [state.particles for state in four[0]]),
        "log_weights": distance([state.log_weights for state in one[0]], [state.log_weights for state in four[0]]),
        "evidence": distance(one[1], four[1]),
        "rounded": distance([state.particles for state in one[0]], [state.particles for state in other]),
        "rows": one[0][0].particles.shape[0],
        "one": one[2],
        "four": four[2],
        "work": four[3] / one[3],
    }


def _rounded_otherwise(seen: np.ndarray) -> np.ndarray:
    """Real numbers, each another one in the last bit; masks as they are."""
    return np.nextafter(seen, np.inf) if np.issubdtype(seen.dtype, np.floating) else seen


def _particles(rng_key, state, info, inputs):
    return state.particles


def _refused(posed: Problem) -> str:
    first = posed.at(0)
    try:
        jax.eval_shape(sharded(particle_filter(posed.model, 10), 4).init, jax.random.key(0), *first)
    except ValueError as error:
        return str(error)
    return ""


def drive(posed: Problem) -> dict:
    """A run on one device and on four, and one that is resumed; how many programs were compiled for the later frames."""
    one, four = particle_filter(posed.model, 200), sharded(particle_filter(posed.model, 200), 4)

    def run(filter_: Filter, **options) -> np.ndarray:
        data = posed.observations, posed.inputs
        return run_filter(filter_, jax.random.key(0), *data, collect=_particles, chunk=2, **options).outputs

    scans: list[str] = []

    def listen(event: str, seconds: float, fun_name: str = "", **details) -> None:
        if "backend_compile" in event and "scan_frames" in fun_name:
            scans.append(fun_name)

    jax.monitoring.register_event_duration_secs_listener(listen)
    with tempfile.TemporaryDirectory() as folder:
        on_four = run(four, checkpoint=Checkpoint(folder))
        compiled = len(scans)
        sorted(Path(folder).glob("part-*"))[-1].unlink()
        resumed = run(four, checkpoint=Checkpoint(folder, resume=True))
    return {
        "distance": float(np.abs(on_four - run(one)).max()),
        "resumed": float(np.abs(on_four - resumed).max()),
        "compiled": compiled,
        "refused": _refused(posed),
    }


if __name__ == "__main__":
    print(json.dumps({name: drive(problem()) if name == "driver" else compare(name, problem()) for name in sys.argv[1:]}))
