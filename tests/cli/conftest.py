"""Fixtures of the command line's tests."""

from __future__ import annotations

import pytest


@pytest.fixture
def without_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Results without their pictures, which take a second each and are drawn by other tests."""
    monkeypatch.setattr("poseppl.report.plot_track", lambda tree: None)
    monkeypatch.setattr("poseppl.report.save_picture", lambda picture, path: None)
