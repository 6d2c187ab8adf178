"""Switching linear Gaussian models by enumeration: a Kalman filter for each sequence of finite states, in plain loops."""

from __future__ import annotations

import itertools

import numpy as np
from oracles.kalman import KalmanResult


def switching_filter(initial, transition, first, later, observe, ys):
    """Filtered moments of (k, x) and evidence increments, exactly.

    ``first(k)`` gives mean and covariance of x_0; ``later(j, k)`` gives (A, b, Q) of x_t given x_(t-1), k_(t-1) = j, k_t = k;
    ``observe`` is (H, h, R) of y = H x + h + noise; rows of ``ys`` (T, k) that are NaN are missing.
    """
    H, h, R = observe
    count = len(initial)
    paths = [(np.log(initial[k]), (k,), *first(k)) for k in range(count)]
    rows, before = [], 0.0
    for t, y in enumerate(ys):
        if t:
            paths = [_step(path, k, transition, later(path[1][-1], k)) for path, k in itertools.product(paths, range(count))]
        if np.isfinite(y).all():
            paths = [_update(path, y - h, H, R) for path in paths]
        log_weights = np.array([path[0] for path in paths])
        total = np.logaddexp.reduce(log_weights)
        weights = np.exp(log_weights - total)
        means = np.array([np.append(path[1][-1], path[2]) for path in paths])
        mean = weights @ means
        spread = np.zeros((len(mean), len(mean)))
        for weight, each, path in zip(weights, means, paths, strict=True):
            spread += weight * np.outer(each - mean, each - mean)
            spread[1:, 1:] += weight * path[3]
        rows.append((mean, spread, total - before))
        before = total
    means, covariances, increments = (np.array(column) for column in zip(*rows, strict=True))
    return KalmanResult(means, covariances, None, None, increments)


def _step(path, k, transition, moves):
    log_weight, states, m, P = path
    A, b, Q = moves
    return log_weight + np.log(transition[states[-1]][k]), (*states, k), A @ m + b, A @ P @ A.T + Q


def _update(path, y, H, R):
    log_weight, states, m, P = path
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    residual = y - H @ m
    log_density = -0.5 * (residual @ np.linalg.solve(S, residual) + np.linalg.slogdet(2 * np.pi * S)[1])
    return log_weight + log_density, states, m + K @ residual, P - K @ S @ K.T
