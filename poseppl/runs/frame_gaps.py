"""Gaps between frame numbers: a warning, or frames without data in their place.

The stride of a sequence is the greatest common divisor of its steps. Frames 0, 2, 4 have no gap; 0, 1, 50, 51 have one.

>>> Gaps([0, 1, 4, 5]).numbers.tolist(), Gaps([0, 1, 4, 5]).rows.tolist(), bool(Gaps([0, 2, 4]))
([0, 1, 2, 3, 4, 5], [0, 1, 1, 1, 2, 3], False)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseppl.arrays import Booleans, Integers
from poseppl.errors import Argument, InputError, Phrase
from poseppl.program import Observation
from poseppl.program.frame_inputs import Constant, check_input_rows

_MAX = 1_000_000
"""Frames of a sequence whose gaps are filled."""


class Gaps:
    """The gaps of a sequence, if any; it is true where there are some.

    Args:
        frames: Frame numbers (T,), whole and increasing.
    """

    def __init__(self, frames: ArrayLike) -> None:
        self.frames: Integers = np.asarray(frames, np.int64)
        steps = np.diff(self.frames)
        self.stride = int(np.gcd.reduce(steps)) if len(steps) else 1
        self._wide = np.flatnonzero(steps > self.stride)

    def __bool__(self) -> bool:
        return len(self._wide) > 0

    def __str__(self) -> str:
        """The first gap, and how many more there are."""
        before = self._wide[0]
        first, last = self.frames[before] + self.stride, self.frames[before + 1] - self.stride
        others = len(self._wide) - 1
        more = f" (and {others} more gap{'s' * (others > 1)})" if others else ""
        return (f"frame {first} is missing" if first == last else f"frames {first} to {last} are missing") + more

    @property
    def numbers(self) -> Integers:
        """Numbers of all frames, those of gaps among them.

        Raises:
            InputError: They are too many.
        """
        first, last = int(self.frames[0]), int(self.frames[-1])
        if (last - first) // self.stride >= _MAX:
            raise InputError(f"{self}", field="frames", expected=f"at most {_MAX} frames, if gaps are to be filled")
        return np.arange(first, last + 1, self.stride)

    @property
    def rows(self) -> Integers:
        """For each of all frames the row of the last one that was given."""
        return np.searchsorted(self.frames, self.numbers, side="right") - 1

    @property
    def inserted(self) -> Booleans:
        """Which of all frames are inserted."""
        return ~np.isin(self.numbers, self.frames)


def inputs_of_all_frames(inputs: Any, frames: ArrayLike) -> Any:
    """Inputs of a sequence whose gaps are filled: those of an inserted frame repeat the frame before.

    A smoother of a result of ``infer(..., frames=frames, fill_gaps=True)`` needs them.

    Args:
        inputs: Inputs with a leading T, constant parts wrapped in :class:`~poseppl.runs.run.Constant`.
        frames: Frame numbers (T,).
    """
    gaps = Gaps(frames)
    if not gaps:
        return inputs
    check_input_rows(inputs, len(gaps.frames))
    return jax.tree.map(
        lambda leaf: leaf if isinstance(leaf, Constant) else np.asarray(leaf)[gaps.rows],
        inputs,
        is_leaf=lambda node: isinstance(node, Constant),
    )


def data_of_all_frames(observations: Observation, gaps: Gaps) -> Observation:
    """Data (T, ...) with inserted frames in which nothing is observed."""
    rows, seen = gaps.rows, ~gaps.inserted
    values, mask = ({name: np.asarray(leaf)[rows] for name, leaf in part.items()} for part in observations)
    known: Any = {name: leaf & seen.reshape(-1, *(1,) * (leaf.ndim - 1)) for name, leaf in mask.items()}
    return Observation(dict[str, Any](values), known)


def truth_of_all_frames(truth: ArrayLike | None, gaps: Gaps) -> NDArray[Any] | None:
    """True flat states (T, d) with NaN in inserted frames."""
    return None if truth is None else np.where(gaps.inserted[:, None], np.nan, np.asarray(truth)[gaps.rows])


def tell_gaps(gaps: Gaps, note: Callable[[str], None]) -> tuple[str, ...]:
    """Warn of gaps that stay, and return the warning, if any."""
    if not gaps:
        return ()
    across = f"{gaps}: one transition leads across a gap, as if its ends were neighbours"
    text = Phrase(f"{across}; insert frames without data by ", Argument("fill_gaps", True))
    note(text)
    return (str(text),)


def tell_filled(gaps: Gaps, inputs: Any, note: Callable[[str], None]) -> None:
    """Say how many frames are inserted."""
    repeated = "" if inputs is None else "; their inputs repeat those of the frame before"
    note(f"{gaps}: {int(gaps.inserted.sum())} frames without data are inserted{repeated}")
