"""The driver: chunks, compilations, online, failures, constants."""

from __future__ import annotations

import logging
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from poseppl_models.toys.linear_gaussian import linear_gaussian

from poseppl.filters import Filter, FilterInfo, ParticleState, kalman_filter, particle_filter
from poseppl.program import Observation, StateSpaceModel
from poseppl.runs import compiled_scan
from poseppl.runs.collectors import collect_draws
from poseppl.runs.online import Online
from poseppl.runs.run import Constant, RunError, frame_inputs, run_filter


class Controls(NamedTuple):
    drift: Any
    scale: Any


def driven_model() -> StateSpaceModel:
    def initial(params, inputs):
        numpyro.sample("x", dist.Normal(0.0, inputs.scale))

    def transition(params, state, inputs):
        numpyro.sample("x", dist.Normal(state["x"] + inputs.drift, inputs.scale))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], 1.0))

    return StateSpaceModel(initial, transition, observation)


def counted(filter: Filter) -> tuple[Filter, dict[str, int]]:
    """The filter, and how often its functions were traced."""
    count = {"init": 0, "step": 0}

    def init(*args: Any) -> Any:
        count["init"] += 1
        return filter.init(*args)

    def step(*args: Any) -> Any:
        count["step"] += 1
        return filter.step(*args)

    return Filter(init, step), count


def toy(frames: int) -> tuple[Any, Observation]:
    model = linear_gaussian(2).compile()
    values = np.sin(np.arange(frames)[:, None] / 3 + np.arange(2))
    values[frames // 2] = np.nan
    return model, model.observe({"y": values})


@pytest.mark.full
def test_what_an_earlier_run_compiled_serves_other_data():
    model, observations = toy(5)
    filter, count = counted(particle_filter(model, 20))
    other = observations._replace(values={name: values + 1 for name, values in observations.values.items()})

    def collect(rng_key: Any, state: Any, info: Any, inputs: Any) -> Any:
        return state.particles, info.log_evidence

    first = run_filter(filter, jax.random.key(0), observations, collect=collect)
    traced = dict(count)
    found = run_filter(filter, jax.random.key(1), other, collect=collect)
    anew = run_filter(counted(particle_filter(model, 20))[0], jax.random.key(1), other, collect=collect)
    assert count == traced
    for again, expected, before in zip(found.outputs, anew.outputs, first.outputs, strict=True):
        np.testing.assert_array_equal(again, expected)
        assert not np.array_equal(again, before)


@pytest.mark.full
def test_a_sequence_of_any_length_is_one_compilation() -> None:
    model, _ = toy(19)
    filter, count = counted(particle_filter(model, 64))
    collect = collect_draws(model, max_draws=16)
    runs = {}
    values = np.sin(np.arange(19)[:, None] / 3 + np.arange(2))
    for frames in (5, 8, 19):
        observations = model.observe({"y": values[:frames]})
        runs[frames] = run_filter(filter, jax.random.key(3), observations, num_frames=frames, collect=collect)
        assert count == {"init": 1, "step": 1}
    for frames in (5, 8):
        jax.tree.map(
            lambda short, long, frames=frames: np.testing.assert_array_equal(short, long[:frames]),
            runs[frames].outputs,
            runs[19].outputs,
        )
    assert runs[19].info.log_evidence.shape == (19,)
    assert runs[19].info.ancestors.shape == (19, 0)
    assert runs[19].unique_ancestors[0] == 64 and np.all(runs[19].unique_ancestors[1:] < 64)
    assert runs[19].state.particles.shape == (64, 2)


def test_each_particle_of_a_closed_form_is_its_own_ancestor() -> None:
    model, observations = toy(5)
    run = run_filter(kalman_filter(model, 64), jax.random.key(0), observations, collect=collect_draws(model, max_draws=4))
    assert np.all(run.unique_ancestors == 64)


def test_chunks_do_not_change_the_result() -> None:
    model, observations = toy(11)
    filter, collect = particle_filter(model, 50), collect_draws(model, max_draws=10)
    first, *others = (
        run_filter(filter, jax.random.key(0), observations, num_frames=11, collect=collect, chunk=chunk) for chunk in (3, 8, 99)
    )
    for other in others:
        jax.tree.map(np.testing.assert_array_equal, first.outputs, other.outputs)
        jax.tree.map(np.testing.assert_array_equal, first.state, other.state)


@pytest.mark.full
@pytest.mark.parametrize("size", [1, 2**18])
def test_parts_longer_than_a_scan_are_several_scans(size: int) -> None:
    """And frames of more than a megabyte make shorter ones."""
    model, observations = toy(70)
    filter, count = counted(particle_filter(model, 4))

    def collect(rng_key: Any, state: Any, info: FilterInfo, inputs: Any) -> Any:
        return state.particles, jnp.zeros(size)

    runs = [run_filter(filter, jax.random.key(0), observations, collect=collect, chunk=chunk) for chunk in (None, 69, 5)]
    for run in runs[1:]:
        np.testing.assert_array_equal(run.outputs[0], runs[0].outputs[0])
    assert runs[0].outputs[0].shape == (70, 4, 2) and count == {"init": 1, "step": 1}


@pytest.mark.full
def test_online_equals_the_scan_and_compiles_once() -> None:
    model, observations = toy(9)
    plain = particle_filter(model, 40)
    filter, count = counted(plain)

    def collect(rng_key: Any, state: Any, info: FilterInfo, inputs: Any) -> Any:
        return state

    run = run_filter(plain, jax.random.key(5), observations, num_frames=9, collect=collect)
    online = Online(filter, jax.random.key(5))
    for frame in range(9):
        state, info = online.update(jax.tree.map(lambda leaf, t=frame: leaf[t], observations))
        np.testing.assert_allclose(state.particles, run.outputs.particles[frame], rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(info.log_evidence, run.info.log_evidence[frame], rtol=1e-5, atol=1e-6)
    assert count == {"init": 1, "step": 1}


@pytest.mark.full
def test_inputs_vary_by_frame_or_are_constant() -> None:
    frames = 6
    drift = jnp.arange(frames, dtype=float)
    inputs: Any = Controls(drift, Constant(jnp.array(0.01)))
    model = driven_model().compile(frame_inputs(inputs, 0))
    observations = model.observe({"y": np.full(frames, np.nan)})
    collect = collect_draws(model)
    filter = particle_filter(model, 200)
    run = run_filter(filter, jax.random.key(1), observations, inputs, num_frames=frames, collect=collect)
    error = 5 * 0.01 * np.sqrt(frames / 200) + 0.01
    np.testing.assert_allclose(run.outputs.summary["state_mean"][:, 0], np.cumsum(drift), atol=error)
    copied = Controls(drift, jnp.full(frames, 0.01))
    again = run_filter(filter, jax.random.key(1), observations, copied, num_frames=frames, collect=collect)
    np.testing.assert_allclose(again.outputs.state, run.outputs.state, rtol=1e-5, atol=1e-6)


def test_a_wrong_number_of_frames_is_refused() -> None:
    model, observations = toy(5)
    with pytest.raises(ValueError, match="leading axis of 6 frames"):
        run_filter(particle_filter(model, 4), jax.random.key(0), observations, num_frames=6, collect=collect_draws(model))
    with pytest.raises(ValueError, match="chunk is 0"):
        run_filter(
            particle_filter(model, 4), jax.random.key(0), observations, num_frames=5, collect=collect_draws(model), chunk=0
        )


@pytest.mark.parametrize(
    ("inputs", "match"),
    [
        ({"push": np.zeros(4)}, r"inputs\['push'\] has shape \(4,\); expected a leading axis of 5 frames"),
        ({"push": [0.0] * 5}, r"inputs\['push'\]\[0\] has shape \(\); .*numpy.asarray makes an array of a list of numbers"),
        ({"push": np.arange(5).astype("M8[D]")}, r"inputs\['push'\] is of the type datetime64\[D\]; expected numbers"),
        ({"push": ["a"] * 5}, r"inputs\['push'\]\[0\] is of the type <U1; expected numbers"),
    ],
)
def test_inputs_that_do_not_fit_are_named(inputs: Any, match: str) -> None:
    model, observations = toy(5)
    with pytest.raises(ValueError, match=match):
        run_filter(particle_filter(model, 4), jax.random.key(0), observations, inputs, collect=collect_draws(model))


@pytest.mark.full
def test_inputs_that_are_not_finite_are_named() -> None:
    """In a transition they break the state, in an observation they make data impossible."""
    inputs = {"drift": np.array([0.0, 0.0, np.nan]), "height": np.zeros(3)}

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("level", dist.Normal(0.0, 1.0))

    def transition(params: Any, state: Any, inputs: Any) -> None:
        numpyro.sample("level", dist.Normal(state["level"] + inputs["drift"], 1.0))

    def observation(params: Any, state: Any, inputs: Any) -> None:
        numpyro.sample("y", dist.Normal(state["level"] + inputs["height"], 1.0))

    model = StateSpaceModel(initial, transition, observation).compile({"drift": 0.0, "height": 0.0})
    filter, observations = particle_filter(model, 4), model.observe({"y": np.zeros(3)})
    with pytest.raises(RunError, match="frame 2: .*not finite.*an input of this frame is NaN or infinite"):
        run_filter(filter, jax.random.key(0), observations, inputs, collect=collect_draws(model))
    swapped = {"drift": inputs["height"], "height": inputs["drift"]}
    with pytest.raises(RunError, match="frame 2: the data are impossible.*an input of this frame is NaN or infinite"):
        run_filter(filter, jax.random.key(0), observations, swapped, collect=collect_draws(model), on_failure="stop")


def failing(at: int, broken: bool = False) -> tuple[Any, Filter]:
    """A random walk whose filter says that it failed at a frame, or whose state is NaN from there on."""
    model, _ = toy(2)

    def info_of(frame: Any) -> FilterInfo:
        zero, number = jnp.zeros(()), jnp.int32(0)
        ancestors = jnp.arange(4, dtype=jnp.int32)
        return FilterInfo(zero, zero, ancestors, zero, number, number, number, (frame == at) & (not broken), zero)

    def init(rng_key: Any, observation: Any, inputs: Any) -> Any:
        return ParticleState(jnp.zeros((4, 2)), jnp.zeros(4)), info_of(0)

    def step(rng_key: Any, state: Any, observation: Any, inputs: Any) -> Any:
        particles = state.particles + 1
        wrong = broken & (particles[0, 0] == at)
        return ParticleState(jnp.where(wrong, jnp.nan, particles), jnp.zeros(4)), info_of(particles[0, 0])

    return model, Filter(init, step)


def run_failing(at: int, broken: bool = False, **options: Any) -> Any:
    model, filter = failing(at, broken)
    observations = model.observe({"y": np.zeros((7, 2))})
    return run_filter(filter, jax.random.key(0), observations, num_frames=7, collect=collect_draws(model), chunk=4, **options)


@pytest.mark.full
def test_a_failed_frame_is_reported_by_its_number_and_the_run_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, logger="poseppl"):
        run = run_failing(5, frame_numbers=range(100, 107))
    assert run.failed == (105,)
    assert len(caplog.messages) == 1 and "frame 105" in caplog.messages[0]
    assert len(run.outputs.state) == 7


@pytest.mark.full
def test_a_failed_frame_stops_the_run_where_asked() -> None:
    with pytest.raises(RunError, match="frame 5.*impossible") as caught:
        run_failing(5, on_failure="stop")
    assert caught.value.frame == 5
    assert caught.value.done is not None and len(caught.value.done.outputs.state) == 5


@pytest.mark.full
@pytest.mark.parametrize("policy", ["continue", "stop"])
@pytest.mark.parametrize("at", [1, 3, 5, 6])
def test_a_state_that_is_not_finite_is_never_passed_over_and_the_frames_before_it_are_kept(policy: str, at: int) -> None:
    whole = run_failing(100)
    with pytest.raises(RunError, match=f"frame {at}.*not finite") as caught:
        run_failing(at, broken=True, on_failure=policy)
    done = caught.value.done
    assert done is not None and done.failed == () and done.info.ess.shape == (at,)
    np.testing.assert_array_equal(done.outputs.state, whole.outputs.state[:at])
    np.testing.assert_array_equal(done.state.particles, at - 1)  # the state after the last good frame


@pytest.mark.full
def test_a_run_that_breaks_down_at_once_has_nothing_to_keep() -> None:
    model, filter = failing(100)

    def init(*args: Any) -> Any:
        state, info = filter.init(*args)
        return state._replace(particles=state.particles + jnp.nan), info

    broken, observations = Filter(init, filter.step), model.observe({"y": np.zeros((7, 2))})
    with pytest.raises(RunError, match="frame 0.*not finite") as caught:
        run_filter(broken, jax.random.key(0), observations, num_frames=7, collect=collect_draws(model))
    assert caught.value.done is None


@pytest.mark.full
def test_a_fault_that_does_not_come_again_ends_no_run() -> None:
    model, filter = failing(100)
    seen: list[float] = []

    def once(place: Any) -> Any:
        """NaN the first time that frame 5 is computed: no program does this but by a fault."""
        seen.append(float(place))
        return np.float32(np.nan if place == 5 and seen.count(5.0) == 1 else 0.0)

    def step(rng_key: Any, state: Any, observation: Any, inputs: Any) -> Any:
        new, info = filter.step(rng_key, state, observation, inputs)
        fault = jax.pure_callback(once, jax.ShapeDtypeStruct((), jnp.float32), new.particles[0, 0])
        return new._replace(particles=new.particles + fault), info

    told = Told()
    observations = model.observe({"y": np.zeros((7, 2))})
    options = {"num_frames": 7, "collect": collect_draws(model), "chunk": 4, "progress": told}
    run = run_filter(Filter(filter.init, step), jax.random.key(0), observations, **options)
    assert seen.count(5.0) == 2
    assert np.array_equal(run.outputs.state[:, 0, 0, 0], np.arange(7.0))
    assert told.frames == 7 and len(told.notes) == 1 and "frames 5 to 6" in told.notes[0]


@pytest.mark.full
def test_impossible_data_of_a_real_model(caplog: pytest.LogCaptureFixture) -> None:
    model = linear_gaussian(2, R=1e-10 * np.eye(2)).compile()
    values = np.zeros((6, 2))
    values[3] = 1e6
    with caplog.at_level(logging.WARNING, logger="poseppl"):
        run = run_filter(
            particle_filter(model, 50),
            jax.random.key(0),
            model.observe({"y": values}),
            num_frames=6,
            collect=collect_draws(model),
        )
    # an underflow of every weight is no -inf in logs; only frames that the filter flags are reported
    assert run.failed == tuple(np.flatnonzero(run.info.failed))
    assert np.isfinite(run.outputs.state).all()


class Told:
    def __init__(self) -> None:
        self.frames = 0
        self.notes: list[str] = []

    def advance(self, frames: int) -> None:
        self.frames += frames

    def note(self, message: str) -> None:
        self.notes.append(message)


@pytest.mark.full
def test_progress_is_reported_every_frame() -> None:
    told = Told()
    run_failing(100, progress=told)
    assert told.frames == 7


def counting(compiles: Callable[..., Any], done: list[str]) -> Callable[..., Any]:
    """A model with a program that compiles, and reports it."""

    def compiling(*given: Any, **named: Any) -> Any:
        done.append("compiled")
        return compiles(*given, **named)

    return compiling


@pytest.mark.full
@pytest.mark.parametrize("build", [particle_filter, kalman_filter])
def test_the_time_of_the_frames_holds_no_compilation(build: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock on which nothing takes time but to trace the collector, and to compile: a second each."""
    done: list[str] = []
    clock = SimpleNamespace(perf_counter=lambda: float(len(done)), process_time=lambda: 0.0)
    for module in ("run", "course"):
        monkeypatch.setattr(f"poseppl.runs.{module}.time", clock)
    for name in ("compile_lowered", "compile_to_run_once"):
        monkeypatch.setattr(compiled_scan, name, counting(getattr(compiled_scan, name), done))
    model, observations = toy(5)
    filter = build(model, 16)
    for _ in range(2):  # each time with a collector that nothing was compiled for
        done.clear()

        def collect(rng_key: Any, state: Any, info: FilterInfo, inputs: Any) -> Any:
            done.append("traced")
            return state.particles

        run = run_filter(filter, jax.random.key(0), observations, collect=collect)
        assert run.wall_seconds == 0.0
        assert run.compile_seconds == len(done) and set(done) == {"traced", "compiled"}
        times = len(done)
        for frames in (5, 70):
            run_filter(filter, jax.random.key(1), toy(frames)[1], collect=collect)
        assert len(done) == times


@pytest.mark.full
@pytest.mark.parametrize(("noise", "collapses"), [(1e-4, True), (1.0, False)])
def test_a_filter_that_collapses_is_reported(noise: float, collapses: bool) -> None:
    model = linear_gaussian(2, R=noise**2 * np.eye(2)).compile()
    told = Told()
    observations = model.observe({"y": np.sin(np.arange(6)[:, None] + np.arange(2))})
    run = run_filter(particle_filter(model, 100), jax.random.key(0), observations, collect=collect_draws(model), progress=told)
    assert bool((run.info.ess < 2).any()) == collapses
    assert len(told.notes) == collapses
    assert not collapses or "fewer than 2 of 100 particles are effective" in told.notes[0]
