"""A learned activity's states in its first three components, as Fig. 1 of Darby, Li and Costen (2008)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from poseppl.arrays import Floats
from poseppl.motion.learned.motion_model import MotionModel

_COMPONENTS = ("1st component", "2nd component", "3rd component")


def plot_states(model: MotionModel, sequences: Sequence[tuple[str, Floats]], *, num_frames: int = 500, seed: int = 0) -> Figure:
    """Draw the features of recordings, and the states (crosses of one standard deviation) with a sequence that they emit.

    Args:
        model: The model, of two components at least.
        sequences: Person and features (T, eta) of each recording.
        num_frames: Number of frames of the sequence that is emitted.
        seed: Seed of that sequence.

    Raises:
        ValueError: The model has a single component.
    """
    shown = min(3, model.components.shape[1])
    if shown < 2:
        raise ValueError("the model has a single component. Expected two or three to draw.")
    kind: dict[str, Any] = {"projection": "3d"} if shown == 3 else {}
    figure = Figure((11.0, 5.2), layout="constrained")
    left, right = (figure.add_subplot(1, 2, number, **kind) for number in (1, 2))
    persons = list(dict.fromkeys(person for person, _ in sequences))
    for person, features in sequences:
        number = persons.index(person)
        first = next(index for index, (other, _) in enumerate(sequences) if other == person)
        label = person if sequences[first][1] is features else None
        left.plot(*features[:, :shown].T, color=f"C{number % 10}", linewidth=0.7, label=label)
    left.set_title("Recordings")
    left.legend(title="person", fontsize=8)
    emitted = emit(model, num_frames, np.random.default_rng(seed))
    right.plot(*emitted[:, :shown].T, ".", color="0.7", markersize=2)
    for number, (mean, covariance) in enumerate(zip(model.means, model.covariances, strict=True)):
        values, vectors = np.linalg.eigh(covariance)
        for axis in (vectors * np.sqrt(np.maximum(values, 0.0))).T[-2:]:
            right.plot(*np.stack([mean - axis, mean + axis], 1)[:shown], color="C3", linewidth=1)
        right.text(*mean[:shown], str(number), fontsize=7)
    right.set_title(f"{len(model.means)} states and {num_frames} emitted frames")
    for axes in (left, right):
        if shown == 3:
            axes.set_box_aspect(None, zoom=0.85)  # labels stay within the picture
        for letter, label in zip("xyz", _COMPONENTS[:shown], strict=False):
            getattr(axes, f"set_{letter}label")(f"{label}, radians")
    return figure


def emit(model: MotionModel, num_frames: int, rng: np.random.Generator) -> Floats:
    """Features (T, eta) that the model emits in so many frames."""
    lower = np.linalg.cholesky(model.covariances)
    state = rng.choice(len(model.initial), p=model.initial)
    emitted = []
    for _ in range(num_frames):
        emitted.append(model.means[state] + lower[state] @ rng.standard_normal(len(lower[state])))
        state = rng.choice(len(model.initial), p=model.transition[state])
    return np.array(emitted)
