"""People who lack a kind of cone can distinguish adjacent colours, in the light and in the dark theme."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

from poseppl.report import page
from poseppl.report.picture import MODES, OBSERVED, POSTERIOR, TRUTH

# Machado, Oliveira and Fernandes 2009, doi:10.1109/TVCG.2009.113, severity 1
SIGHT = {
    "all cones": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
DISTINCT = 15.0  # CIE 1976; 2.3 is just noticed


def lab(color: str, sight: str) -> np.ndarray:
    coded = np.array([int(color[place : place + 2], 16) for place in (1, 3, 5)]) / 255
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    x = XYZ @ np.clip(np.array(SIGHT[sight]) @ linear, 0, 1) / [0.9505, 1.0, 1.089]
    f = np.where(x > 0.008856, np.cbrt(x), 7.787 * x + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def least_distance(colors: list[str], sight: str) -> float:
    return min(float(np.linalg.norm(lab(a, sight) - lab(b, sight))) for a, b in itertools.combinations(colors, 2))


@pytest.mark.parametrize("sight", SIGHT)
def test_colors_differ(sight: str) -> None:
    day = [POSTERIOR, OBSERVED, TRUTH, *MODES]
    environment = page.environment_of("poseppl.report")
    script = environment.loader.get_source(environment, "page.js")[0]  # type: ignore[union-attr]
    night = dict(re.findall(r'"?(#[0-9a-f]{6})"?: "(#[0-9a-f]{6})"', script))
    assert set(day) <= set(night)
    for colors, ground in ((day, "#ffffff"), ([night[color] for color in day], "#1b1f24")):
        assert least_distance([*colors, ground], sight) > DISTINCT


@pytest.mark.full
def test_colors_that_some_confuse_are_noticed() -> None:
    assert (
        least_distance(["#1f6f8b", "#7a5195"], "deuteranopia") < DISTINCT < least_distance(["#1f6f8b", "#7a5195"], "all cones")
    )
