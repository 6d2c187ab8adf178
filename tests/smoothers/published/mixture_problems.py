"""A linear Gaussian model whose likelihoods are known mixtures, solved by going through all sequences of components."""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from poseppl_models.toys.linear_gaussian import LinearGaussian, linear_gaussian_matrices, linear_gaussian_model

from poseppl.program import CompiledModel, Observation
from poseppl.smoothers.published.likelihood_mixture import LikelihoodMixture, mixture_of_gaussians


class MixtureProblem(NamedTuple):
    matrices: LinearGaussian
    model: CompiledModel
    observations: Observation  # which nobody reads
    inputs: jnp.ndarray  # (T, 1)
    weights: np.ndarray  # (T, K)
    means: np.ndarray  # (T, K, d)
    covariances: np.ndarray  # (T, K, d, d)

    @property
    def mixture(self) -> LikelihoodMixture:
        return mixture_of_gaussians(np.log(self.weights), self.means, self.covariances)


def mixture_problem(num_frames=3, num_components=2, dimension=2, separation=1.0, seed=0) -> MixtureProblem:
    rng = np.random.default_rng(seed)
    d = dimension
    matrices = linear_gaussian_matrices(
        d, A=0.8 * np.eye(d) + 0.2 * np.eye(d, k=1), Q=0.3 * np.eye(d) + 0.1, B=3 * rng.normal(size=(d, 1))
    )
    inputs = rng.normal(size=(num_frames, 1))
    weights = rng.dirichlet(np.full(num_components, 5.0), num_frames)
    means = separation * rng.normal(size=(num_frames, num_components, d))
    roots = 0.7 * np.eye(d) + 0.2 * rng.normal(size=(num_frames, num_components, d, d))
    covariances = roots @ np.swapaxes(roots, -1, -2)
    model = linear_gaussian_model(matrices).compile(inputs[0])
    observations = model.observe({"y": np.zeros((num_frames, d))})
    return MixtureProblem(matrices, model, observations, jnp.asarray(inputs), weights, means, covariances)


class Exact(NamedTuple):
    log_evidence: float
    means: np.ndarray  # (T, d)
    covariance: np.ndarray  # (T d, T d)


def exact_smoothing(problem: MixtureProblem) -> Exact:
    """Moments of p(x | z) with the mixture for the likelihood, as one Gaussian for each sequence of components."""
    num_frames, num_components, d = problem.means.shape
    prior_mean, prior_covariance = joint_prior(problem.matrices, np.asarray(problem.inputs, float))
    logs, means, covariances = [], [], []
    for sequence in product(range(num_components), repeat=num_frames):
        chosen = list(zip(range(num_frames), sequence, strict=True))
        centre = np.concatenate([problem.means[pair] for pair in chosen])
        noise = block_diagonal([problem.covariances[pair] for pair in chosen])
        spread = prior_covariance + noise
        gain = prior_covariance @ np.linalg.inv(spread)
        residual = centre - prior_mean
        log_weight = sum(np.log(problem.weights[pair]) for pair in chosen)
        logs.append(log_weight + log_normal(residual, spread))
        means.append(prior_mean + gain @ residual)
        covariances.append(prior_covariance - gain @ prior_covariance)
    logs, means, covariances = np.array(logs), np.array(means), np.array(covariances)
    log_evidence = np.logaddexp.reduce(logs)
    shares = np.exp(logs - log_evidence)
    mean = shares @ means
    second = np.tensordot(shares, covariances + means[:, :, None] * means[:, None, :], 1)
    return Exact(float(log_evidence), mean.reshape(num_frames, d), second - np.outer(mean, mean))


def joint_prior(matrices: LinearGaussian, inputs: np.ndarray | None, num_frames: int | None = None) -> Any:
    """Mean (T d,) and covariance (T d, T d) of the states of all frames before any data."""
    A, Q, _, _, m, P, B = matrices
    num_frames = len(inputs) if num_frames is None else num_frames
    d = len(m)
    means, covariance = [m], np.zeros((num_frames * d, num_frames * d))
    covariance[:d, :d] = P
    for t in range(1, num_frames):
        means.append(A @ means[-1] + (B @ inputs[t] if B is not None else 0.0))
        now, before = slice(t * d, (t + 1) * d), slice((t - 1) * d, t * d)
        covariance[now, : t * d] = A @ covariance[before, : t * d]
        covariance[: t * d, now] = covariance[now, : t * d].T
        covariance[now, now] = A @ covariance[before, before] @ A.T + Q
    return np.concatenate(means), covariance


def block_diagonal(blocks):
    d = len(blocks[0])
    whole = np.zeros((len(blocks) * d, len(blocks) * d))
    for t, block in enumerate(blocks):
        whole[t * d : (t + 1) * d, t * d : (t + 1) * d] = block
    return whole


def log_normal(residual, covariance):
    quadratic = residual @ np.linalg.solve(covariance, residual)
    return -0.5 * (quadratic + np.linalg.slogdet(covariance)[1] + len(residual) * np.log(2 * np.pi))
