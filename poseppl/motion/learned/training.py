"""Training a model of an activity from poses (Darby, Li and Costen 2008, sections 4, 5 and 7).

The root's and the head's coordinates are taken out, and each person's mean angles subtracted. A hidden Markov model is trained
on the weights of the principal components of the rest; each recording is a sequence. Beyond the paper, the model keeps
how far the angles stay from the components and for how long, and what each coordinate does from frame to frame.

The hidden Markov model has Gaussian emissions and is trained by hmmlearn's Baum-Welch. Means and covariances start from the
clusters of k-means, the rows of the transition matrix at random, and the initial probabilities stay at 1 / N. A covariance is
held off from singular by a hundredth of a frame of the features' own variance. States are numbered around the mean in the
plane of the first two features, so that neighbours in number follow each other in a cyclic motion.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats, Integers
from poseppl.checks import check_at_least
from poseppl.errors import Argument, InputError, Phrase, PosepplError, brief
from poseppl.motion.learned.angles import mean_angle, wrapped
from poseppl.motion.learned.motion_model import MotionModel
from poseppl.motion.learned.posed_recordings import PosedRecording

HEADS = ("neck", "head")
"""Joints of the line of sight, which is left free as is the root."""
_PACKAGES = ("poseppl", "hmmlearn", "scikit-learn", "numpy")


class TrainingSettings(NamedTuple):
    """How a model is trained.

    Attributes:
        num_components: eta.
        num_states: N.
        num_rounds: Rounds of Baum-Welch, at most.
        seed: Seed of k-means and of the transition matrix that training starts from.
        free: Joints that are not learned; the root and those of :data:`HEADS` that the body has if None.
    """

    num_components: int = 4
    num_states: int = 30
    num_rounds: int = 50
    seed: int = 0
    free: tuple[str, ...] | None = None


def train_motion_model(
    recordings: Sequence[PosedRecording],
    model: str,
    settings: TrainingSettings | None = None,
    *,
    advance: Callable[[int], None] = lambda _: None,
) -> MotionModel:
    """Train a model of an activity.

    Args:
        recordings: Recordings of one body at one rate.
        model: Builder of the body, for the record.
        settings: How; the paper's if None.
        advance: Receives the number of finished rounds of Baum-Welch.

    Raises:
        ValueError: A setting is below 1.
        InputError: The recordings differ in rate or coordinates, a joint is unknown, or there are too few frames.
        PosepplError: hmmlearn or scikit-learn are not installed.
    """
    settings = settings or TrainingSettings()
    check_at_least(1, num_components=settings.num_components, num_states=settings.num_states, num_rounds=settings.num_rounds)
    learned = _check(recordings, settings)
    persons = tuple(dict.fromkeys(recording.person for recording in recordings))
    poses = [recording.states[:, learned] for recording in recordings]
    means = np.array([mean_angle(np.concatenate(_of(person, recordings, poses))) for person in persons])
    departures = [
        wrapped(pose - means[persons.index(recording.person)]) for recording, pose in zip(recordings, poses, strict=True)
    ]
    principal = _principal_components(np.concatenate(departures), settings.num_components)
    features = [(departure - principal.centre) @ principal.components for departure in departures]
    markov = baum_welch(features, settings.num_states, num_rounds=settings.num_rounds, seed=settings.seed, advance=advance)
    return MotionModel(
        model,
        recordings[0].rate,
        recordings[0].coordinates,
        learned,
        persons,
        means,
        *principal,
        *markov[:-1],
        *_residuals(departures, principal.centre, principal.components),
        *_steps(recordings),
        _limits(recordings),
        markov.log_likelihoods,
        _provenance(recordings, settings),
    )


def _of(person: str, recordings: Sequence[PosedRecording], values: Sequence[Floats]) -> list[Floats]:
    return [value for recording, value in zip(recordings, values, strict=True) if recording.person == person]


def _check(recordings: Sequence[PosedRecording], settings: TrainingSettings) -> Integers:
    """Indices of the learned coordinates."""
    if not recordings:
        raise InputError("there is no recording to learn from", field=Argument("files"), expected="at least one")
    first = recordings[0]
    for other in recordings:
        if other.coordinates != first.coordinates or abs(other.rate / first.rate - 1) > 1e-3:
            problem = (
                f"{other.rate:g} frames a second and {len(other.coordinates)} coordinates, and those of {first.source} are "
            )
            raise InputError(f"{problem}{first.rate:g} and {len(first.coordinates)}", file=other.source, expected="the same")
    joints = [name.rpartition(".")[0] for name in first.coordinates]
    free = (first.root, *HEADS) if settings.free is None else settings.free
    unknown = [] if settings.free is None else [joint for joint in settings.free if joint not in joints]
    if unknown:
        known = ", ".join(dict.fromkeys(joints))
        raise InputError(f"the body has no joint {brief(unknown[0])}", field=Argument("free"), expected=f"some of {known}")
    if first.root not in free:
        raise InputError(
            f"the root {brief(first.root)} is learned", field=Argument("free"), expected=f"{first.root} among the free joints"
        )
    learned = np.array([index for index, joint in enumerate(joints) if joint not in free], int)
    count = settings.num_components
    if count > len(learned):
        raise InputError(
            f"{count} components of {len(learned)} angles", field=Argument("components"), expected=f"at most {len(learned)}"
        )
    frames = sum(len(recording.states) for recording in recordings)
    needed = settings.num_states * (count + 1)
    if frames < needed:
        expected = Phrase(f"{needed} or more, {count + 1} a state; or fewer ", Argument("states"))
        problem = f"{frames} frames are too few for {settings.num_states} states of {count} components"
        raise InputError(problem, field=Argument("files"), expected=expected)
    short = [recording.source for recording in recordings if len(recording.states) < 2]
    if short:
        raise InputError("a single frame shows no motion", file=short[0], expected="two frames or more")
    return learned


def _residuals(departures: Sequence[Floats], centre: Floats, components: Floats) -> tuple[Floats, Floats]:
    """Standard deviations (L,) of the angles about the components, and their correlations from frame to frame (L,)."""
    left = [departure - centre - (departure - centre) @ components @ components.T for departure in departures]
    variance = np.mean(np.concatenate(left) ** 2, 0)
    product = np.mean(np.concatenate([part[1:] * part[:-1] for part in left]), 0)
    return np.sqrt(variance), np.clip(product / np.where(variance > 0, variance, 1.0), 0.0, 1.0)


def _steps(recordings: Sequence[PosedRecording]) -> tuple[Floats, Floats]:
    """Root mean square and largest change (d,) of each coordinate from frame to frame."""
    changes = np.concatenate([np.diff(recording.states, axis=0) for recording in recordings])
    return np.sqrt(np.mean(changes**2, 0)), np.abs(changes).max(0)


def _limits(recordings: Sequence[PosedRecording]) -> Floats:
    """Least and largest value of each coordinate (d, 2), whole turns apart brought together; infinite for the root."""
    states = np.concatenate([recording.states for recording in recordings])
    middle = mean_angle(states)
    near = middle + wrapped(states - middle)
    root = [name.rpartition(".")[0] == recordings[0].root for name in recordings[0].coordinates]
    limits = np.stack([near.min(0), near.max(0)], 1)
    limits[root] = -np.inf, np.inf
    return limits


def _provenance(recordings: Sequence[PosedRecording], settings: TrainingSettings) -> dict[str, Any]:
    files: NDArray[Any] = np.array([recording.source for recording in recordings])
    return {
        "files": files.tolist(),
        "frames": [len(recording.states) for recording in recordings],
        "file persons": [recording.person for recording in recordings],
        "residuals mm": [round(recording.residual, 3) for recording in recordings],
        "settings": settings._asdict(),
        "versions": {name: version(name) for name in _PACKAGES},
    }


class _PrincipalComponents(NamedTuple):
    """Principal components of L angles.

    Attributes:
        centre: Mean (L,).
        components: Eigenvectors of the eta largest eigenvalues of the covariance (L, eta), the largest entry of each positive.
        spectrum: All eigenvalues (L,), descending.
    """

    centre: Floats
    components: Floats
    spectrum: Floats


def _principal_components(departures: Floats, count: int) -> _PrincipalComponents:
    """Find the principal components of departures (M, L), by the singular values of what is left of them without their mean."""
    centre = departures.mean(0)
    values, vectors = np.linalg.svd(departures - centre, full_matrices=False)[1:]
    spectrum = np.zeros(departures.shape[1])
    spectrum[: len(values)] = values**2 / len(departures)
    components = vectors[:count].T
    largest = np.abs(components).argmax(0)
    signs = np.sign(components[largest, np.arange(count)])
    return _PrincipalComponents(centre, components * signs, spectrum)


INSTALL = "pip install 'poseppl[motion-models]'"
_PSEUDO_FRAMES = 0.01
_TOLERANCE = 1e-2
"""Rise of the log-likelihood at which training ends."""


class HiddenMarkov(NamedTuple):
    """`initial` (N,), `transition` (N, N), `means` (N, eta), `covariances` (N, eta, eta), `log_likelihoods` (rounds,)."""

    initial: Floats
    transition: Floats
    means: Floats
    covariances: Floats
    log_likelihoods: Floats


def load_trainers() -> list[Any]:
    """Hidden Markov models of hmmlearn, clusters of scikit-learn, and what bounds the threads of both.

    Raises:
        PosepplError: One of them is not installed.
    """
    try:
        return [import_module(name) for name in ("hmmlearn.hmm", "sklearn.cluster", "threadpoolctl")]
    except ModuleNotFoundError as error:
        name = {"sklearn": "scikit-learn"}.get(str(error.name), error.name)
        raise PosepplError(f"training needs the package {name}, which is not installed: {INSTALL}") from error


def baum_welch(
    sequences: Sequence[Floats], num_states: int, *, num_rounds: int, seed: int, advance: Callable[[int], None] = lambda _: None
) -> HiddenMarkov:
    """Train a hidden Markov model.

    Args:
        sequences: Features (T, eta) of each recording.
        num_states: N.
        num_rounds: Rounds of Baum-Welch, at most.
        seed: Seed of k-means and of the transition matrix.
        advance: Receives the number of finished rounds.

    Raises:
        PosepplError: hmmlearn or scikit-learn are not installed.
        InputError: A state has lost all of its frames.
    """
    markov, cluster, threads = load_trainers()
    features = np.concatenate(list(sequences))
    rng = np.random.default_rng(seed)
    variances = np.diag(features.var(0))
    trained = markov.GaussianHMM(
        num_states,
        "full",
        n_iter=num_rounds,
        tol=_TOLERANCE,
        params="tmc",
        init_params="",
        covars_prior=_PSEUDO_FRAMES * variances,
        covars_weight=features.shape[1] + _PSEUDO_FRAMES,
    )
    trained.startprob_ = np.full(num_states, 1 / num_states)
    rows = rng.random((num_states, num_states))
    trained.transmat_ = rows / rows.sum(1, keepdims=True)
    trained.monitor_ = _monitor(trained, advance)
    with _silence(), threads.threadpool_limits(1):  # the matrices are small, and threads wait for each other
        trained.means_, trained.covars_ = _clusters(cluster, features, num_states, seed, variances)
        trained.fit(features, [len(sequence) for sequence in sequences])
    lost = trained.transmat_.sum(1) == 0  # a state that nothing was ever seen to follow
    trained.transmat_[lost] = 1 / num_states
    found = (trained.startprob_, trained.transmat_, trained.means_, np.asarray(trained.covars_))
    if not all(np.isfinite(leaf).all() for leaf in found):
        raise InputError(
            f"a state of {num_states} has lost its frames", field=Argument("states"), expected="fewer states, or more frames"
        )
    initial, transition, means, covariances = found
    apart = means - features.mean(0)
    around = np.argsort(np.arctan2(apart[:, 1], apart[:, 0]) if apart.shape[1] > 1 else apart[:, 0], kind="stable")
    ordered = (initial[around], transition[np.ix_(around, around)], means[around], covariances[around])
    return HiddenMarkov(*ordered, np.array(list(trained.monitor_.rounds)))


@contextmanager
def _silence() -> Iterator[None]:
    """No warnings: of states without frames, looked for afterwards, and of likelihoods that the pseudo-frame lowers."""
    log = logging.getLogger("hmmlearn.base")
    before, log.disabled = log.disabled, True
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        log.disabled = before


def _clusters(cluster: Any, features: Floats, count: int, seed: int, variances: Floats) -> tuple[Floats, Floats]:
    """Means (N, eta) and covariances (N, eta, eta) of k-means."""
    found = cluster.KMeans(count, n_init=4, random_state=seed).fit(features)
    covariances = []
    for state in range(count):
        apart = features[found.labels_ == state] - found.cluster_centers_[state]
        covariances.append((apart.T @ apart + _PSEUDO_FRAMES * variances) / (len(apart) + _PSEUDO_FRAMES))
    return found.cluster_centers_, np.array(covariances)


def _monitor(trained: Any, advance: Callable[[int], None]) -> Any:
    """A monitor of convergence that keeps the log-likelihoods of all rounds and reports each."""

    class Monitor(type(trained.monitor_)):  # type: ignore[misc]
        rounds: list[float]

        def _reset(self) -> None:
            super()._reset()
            self.rounds = []

        def report(self, log_prob: float) -> None:
            self.rounds.append(float(log_prob))
            super().report(log_prob)
            advance(1)

    monitor = Monitor(trained.tol, trained.n_iter, False)
    monitor._reset()
    return monitor
