from __future__ import annotations

import numpy as np

from poseppl.diagnostics import effective_number, survival, unique_ancestors


def test_effective_number_of_known_weights() -> None:
    logs = np.log(np.array([[1, 1, 1, 1], [1, 1e-300, 1e-300, 1e-300], [3, 1, 1e-300, 1e-300]]))
    np.testing.assert_allclose(effective_number(logs - 1e4), [4, 1, 16 / 10], rtol=1e-10)


def test_impossible_weights_are_nan_and_silent() -> None:
    assert np.isnan(effective_number(np.full((2, 5), -np.inf))).all()
    assert np.isnan(effective_number(np.array([0.0, np.nan])))


def test_ancestors_against_sets() -> None:
    table = np.random.default_rng(0).integers(0, 30, size=(12, 30))
    assert list(unique_ancestors(table)) == [len(set(row)) for row in table]
    alive, expected = set(range(30)), []
    for row in table[::-1]:
        expected.append(len(alive))
        alive = {int(row[i]) for i in alive}
    assert list(survival(table)) == expected[::-1]
