"""A Kalman filter as a plain NumPy loop, for models of `poseppl_models.toys.linear_gaussian`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class KalmanResult(NamedTuple):
    means: np.ndarray  # (T, d) filtered
    covariances: np.ndarray  # (T, d, d)
    predicted_means: np.ndarray  # (T, d)
    predicted_covariances: np.ndarray  # (T, d, d)
    log_evidence: np.ndarray  # (T,) increments


def kalman_filter(matrices, ys, mask=None, inputs=None):
    """Filter ys (T, k); entries where mask is False are left out."""
    A, Q, H, R, m, P, B = matrices
    ys = np.asarray(ys, float)
    mask = np.ones(ys.shape, bool) if mask is None else np.asarray(mask)
    rows = []
    for t in range(len(ys)):
        if t > 0:
            m = A @ m + (B @ inputs[t] if B is not None else 0.0)
            P = A @ P @ A.T + Q
        m_predicted, P_predicted = m, P
        seen = mask[t]
        h, r = H[seen], R[np.ix_(seen, seen)]
        log_evidence = 0.0
        if seen.any():
            residual = ys[t][seen] - h @ m
            S = h @ P @ h.T + r
            K = P @ h.T @ np.linalg.inv(S)
            m = m + K @ residual
            P = P - K @ S @ K.T
            log_evidence = -0.5 * (
                residual @ np.linalg.solve(S, residual) + np.linalg.slogdet(S)[1] + seen.sum() * np.log(2 * np.pi)
            )
        rows.append((m, P, m_predicted, P_predicted, log_evidence))
    return KalmanResult(*(np.array(column) for column in zip(*rows, strict=True)))


def joint_log_density(matrices, xs, ys, inputs=None):
    """log p(x_0..T-1, y_0..T-1), term by term."""
    A, Q, H, R, m, P, B = matrices
    total = _log_normal(xs[0], m, P)
    for t in range(len(xs)):
        if t > 0:
            mean = A @ xs[t - 1] + (B @ inputs[t] if B is not None else 0.0)
            total += _log_normal(xs[t], mean, Q)
        total += _log_normal(ys[t], H @ xs[t], R)
    return total


def simulate(matrices, num_frames, seed, inputs=None):
    """Draw xs (T, d) and ys (T, k)."""
    A, Q, H, R, m, P, B = matrices
    rng = np.random.default_rng(seed)
    xs, ys = [], []
    for t in range(num_frames):
        if t == 0:
            x = rng.multivariate_normal(m, P)
        else:
            x = rng.multivariate_normal(A @ xs[-1] + (B @ inputs[t] if B is not None else 0.0), Q)
        xs.append(x)
        ys.append(rng.multivariate_normal(H @ x, R))
    return np.array(xs), np.array(ys)


def _log_normal(x, mean, covariance):
    residual = x - mean
    quadratic = residual @ np.linalg.solve(covariance, residual)
    return -0.5 * (quadratic + np.linalg.slogdet(covariance)[1] + len(x) * np.log(2 * np.pi))


def rauch_tung_striebel(matrices, filtered):
    """Smoothed means (T, d) and covariances (T, d, d) from what `kalman_filter` returned."""
    means, covariances = [filtered.means[-1]], [filtered.covariances[-1]]
    for t in range(len(filtered.means) - 2, -1, -1):
        J = smoothing_gain(matrices, filtered, t)
        means.append(filtered.means[t] + J @ (means[-1] - filtered.predicted_means[t + 1]))
        covariances.append(filtered.covariances[t] + J @ (covariances[-1] - filtered.predicted_covariances[t + 1]) @ J.T)
    return np.array(means[::-1]), np.array(covariances[::-1])


def lag_one_covariances(matrices, filtered):
    """Smoothed covariances (T - 1, d, d) of the states of each frame and the next."""
    _, covariances = rauch_tung_striebel(matrices, filtered)
    return np.array([smoothing_gain(matrices, filtered, t) @ P for t, P in enumerate(covariances[1:])])


def smoothing_gain(matrices, filtered, t):
    """Derivative of a frame's mean (d,) by that of the next frame, (d, d)."""
    return np.linalg.solve(filtered.predicted_covariances[t + 1], matrices.A @ filtered.covariances[t]).T


def fixed_lag_moments(matrices, filtered, lag):
    """Means (T, d) and covariances (T, d, d) of every frame given the data of no more than `lag` later ones."""
    num_frames = len(filtered.means)
    ends = [min(t + lag, num_frames - 1) + 1 for t in range(num_frames)]
    known = [rauch_tung_striebel(matrices, KalmanResult(*(part[:end] for part in filtered))) for end in ends]
    return tuple(np.array([part[t] for t, part in enumerate(parts)]) for parts in zip(*known, strict=True))
