"""Hidden Markov models with Gaussian emissions, trained by hmmlearn's Baum-Welch as in Darby, Li and Costen (2008, section 7).

Means and covariances start from the clusters of k-means, the rows of the transition matrix at random, and the initial
probabilities stay at 1 / N. A covariance is held off from singular by a hundredth of a frame of the features' own variance.
States are numbered around the mean in the plane of the first two features, so that neighbours in number follow each other in a
cyclic motion.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError, PosepplError

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
