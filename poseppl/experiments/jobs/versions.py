"""Versions of the libraries that decide a result."""

from __future__ import annotations

from functools import cache
from importlib.metadata import version

_PACKAGES = ("poseppl", "jax", "jaxlib", "numpyro", "blackjax", "numpy")


@cache
def versions() -> dict[str, str]:
    """Versions by the name of the package."""
    return {name: version(name) for name in _PACKAGES}
