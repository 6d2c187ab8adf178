"""Pages of the reference: one for each package, one for each of its modules; docstrings are filled in by Sphinx."""

from __future__ import annotations

from collections.abc import Iterator

from website.algorithms import title
from website.markup import plain
from website.modules import PACKAGES, all_modules, alone, exports, first_sentence, modules_of


def pages() -> dict[str, str]:
    """Names and texts of the pages, in reStructuredText."""
    found = {f"reference/{package}.rst": _package(package) for package in PACKAGES}
    found |= {f"reference/{module}.rst": _module(module) for module in all_modules()}
    return found | {"reference/index.rst": _index()}


def _index() -> str:
    return "\n".join(
        [
            *_title("Python"),
            "All public names by package. Other sites can link to them by `objects.inv`, beside the landing page.",
            "",
            ".. toctree::",
            "   :maxdepth: 1",
            "",
            *(f"   {name}" for name in (*PACKAGES, *alone())),
            "",
        ]
    )


def _package(package: str) -> str:
    modules = modules_of(package)
    lines = [*_title(package), f".. automodule:: {package}", "   :no-members:", ""]
    if exports(package):
        lines += [".. rubric:: Names", "", *_table((each.name, each.module, each.name) for each in exports(package))]
    if package == "poseppl_models":
        lines += [".. autodata:: poseppl_models.BODIES", ""]
    if modules and not exports(package):
        lines += [".. rubric:: Modules", "", *_table((module.rpartition(".")[2], module, None) for module in modules)]
    if modules:
        lines += [".. toctree::", "   :hidden:", "", *(f"   {module}" for module in modules), ""]
    return "\n".join(lines)


def _table(rows: Iterator[tuple[str, str, str | None]]) -> list[str]:
    lines = [".. list-table::", "   :widths: auto", ""]
    for shown, module, name in rows:
        target = f":py:obj:`{shown} <{module}.{name}>`" if name else f":doc:`{shown} <{module}>`"
        lines += [f"   * - {target}", f"     - {plain(first_sentence(module, name))}".rstrip()]
    return [*lines, ""]


def _module(module: str) -> str:
    return "\n".join([*_title(title(module)), f".. automodule:: {module}", "   :members:", "   :show-inheritance:", ""])


def _title(text: str) -> list[str]:
    return [text, "=" * len(text), ""]
