"""The package that rendering needs and the rest of the toolkit does not: MuJoCo, which draws."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

from poseppl.errors import PosepplError, cut

INSTALL = "pip install 'poseppl[render]'"


def load_mujoco() -> Any:
    """Import MuJoCo, set to draw without a screen: ``MUJOCO_GL=egl`` on Linux, unless the user has set it.

    Raises:
        PosepplError: It is not installed, or finds no OpenGL.
    """
    if sys.platform == "linux":
        os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        return importlib.import_module("mujoco")
    except ModuleNotFoundError as error:
        if error.name not in ("mujoco", "OpenGL"):
            raise no_opengl(error) from error
        raise PosepplError(f"rendering needs the package {error.name}, which is not installed: {INSTALL}") from error
    except Exception as error:  # the loader of the GL libraries fails in ways of its own
        raise no_opengl(error) from error


def no_opengl(error: Exception) -> PosepplError:
    """The error to raise where nothing can be drawn."""
    chosen = os.environ.get("MUJOCO_GL", "not set")
    first = (str(error).strip().splitlines() or [type(error).__name__])[0]
    return PosepplError(
        f"MuJoCo finds no OpenGL to draw with, MUJOCO_GL being {chosen} ({cut(first, 200)}); without a screen it needs "
        "MUJOCO_GL=egl, which poseppl sets where you have not, and on Debian: apt-get install libegl1 libgl1 libegl-mesa0"
    )
