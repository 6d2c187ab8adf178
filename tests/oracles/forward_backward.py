"""The forward-backward algorithm as plain NumPy loops, for models of `poseppl_models.toys.finite_hmm`."""

from __future__ import annotations

import numpy as np


def forward_backward(initial, transition, emission, ys):
    """Filtered (T, K), smoothed (T, K) probabilities and evidence increments (T,); ys holds symbols, -1 where missing."""
    initial, transition, emission = (np.asarray(a, float) for a in (initial, transition, emission))
    likelihood = np.array([np.ones(len(initial)) if y < 0 else emission[:, y] for y in ys])
    filtered, increments = [], []
    for t in range(len(ys)):
        predicted = initial if t == 0 else filtered[-1] @ transition
        joint = predicted * likelihood[t]
        increments.append(np.log(joint.sum()))
        filtered.append(joint / joint.sum())
    backward = np.ones(len(initial))
    smoothed = [filtered[-1]]
    for t in range(len(ys) - 2, -1, -1):
        backward = transition @ (likelihood[t + 1] * backward)
        backward /= backward.sum()
        gamma = filtered[t] * backward
        smoothed.append(gamma / gamma.sum())
    return np.array(filtered), np.array(smoothed[::-1]), np.array(increments)
