from __future__ import annotations

import numpy as np

from poseppl.diagnostics import survival, unique_ancestors


def test_ancestors_against_sets() -> None:
    table = np.random.default_rng(0).integers(0, 30, size=(12, 30))
    assert list(unique_ancestors(table)) == [len(set(row)) for row in table]
    alive, expected = set(range(30)), []
    for row in table[::-1]:
        expected.append(len(alive))
        alive = {int(row[i]) for i in alive}
    assert list(survival(table)) == expected[::-1]
