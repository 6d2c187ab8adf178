"""Names under which packages export what their modules define: links from other sites find both."""

from __future__ import annotations

from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

from website.modules import PACKAGES, exports


def _add(app: Sphinx, env: BuildEnvironment) -> None:
    objects = env.domains.python_domain.objects
    for package in PACKAGES:
        for each in exports(package):
            defined = objects.get(f"{each.module}.{each.name}")
            if defined is not None:
                objects.setdefault(f"{package}.{each.name}", defined._replace(aliased=True))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("env-check-consistency", _add)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
