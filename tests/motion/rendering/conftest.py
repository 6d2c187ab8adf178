"""A small scene of the built-in walk; tests that draw skip only where there is no OpenGL."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from poseppl.errors import PosepplError
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.rendering import Setting, Stage, build_setting

SMALL = (96, 72)


@pytest.fixture(scope="session")
def walker() -> Callable[..., Setting]:
    """Builds settings of three frames, a second apart, of the built-in walk."""
    subject = walking_subject(frames="0:61:30")

    def build(**options: object) -> Setting:
        arguments = {"size": SMALL, **options}
        return build_setting(subject.body.tree.marker_names, subject.markers, **arguments)  # type: ignore[arg-type]

    return build


@pytest.fixture(scope="session")
def drawable(walker: Callable[..., Setting]) -> Callable[..., Setting]:
    """The same, for tests that draw."""
    try:
        with Stage(walker(cameras=1)) as stage:
            stage.picture(0)
    except PosepplError as error:
        if "libegl1" in str(error):
            pytest.skip(f"no OpenGL here: {error}")
        raise
    return walker
