"""Pictures of the notebooks show in Jupyter: each is one of our pictures, and the value of its cell."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from poseppl.report import new_picture

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "notebooks").glob("*.py"))
DRAWS = re.compile(r"new_picture|plot_\w+|draw_tuning")


def calls(node):
    """Names of the functions that a piece of code calls."""
    return {call.func.id for call in ast.walk(node) if isinstance(call, ast.Call) and isinstance(call.func, ast.Name)}


def hidden(source):
    """Cells that draw a picture which Jupyter would not show, and how many show one."""
    shown, lost = 0, []
    for cell in re.split(r"^# %%.*$", source, flags=re.MULTILINE):
        body = ast.parse(cell).body
        made = [node for node in body if not isinstance(node, ast.FunctionDef) and any(map(DRAWS.fullmatch, calls(node)))]
        if not made:
            continue
        last = body[-1]
        names = {target.id for node in made if isinstance(node, ast.Assign) for target in node.targets}
        of_name = isinstance(last, ast.Expr) and isinstance(last.value, ast.Name) and last.value.id in names
        if len(made) == 1 and (of_name or (made[0] is last and isinstance(last, ast.Expr))):
            shown += 1
        else:
            lost.append(cell)
    return shown, lost


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem[:2])
def test_each_picture_is_one_of_ours_and_the_value_of_its_cell(path):
    source = path.read_text(encoding="utf-8")
    shown, lost = hidden(source)
    assert shown >= 1 and lost == []
    assert not re.search(r"^(import|from) matplotlib", source, re.MULTILINE)  # whose figures show only with pyplot's backend


def test_a_picture_that_is_not_the_value_of_its_cell_is_noticed():
    assert hidden("# %%\npicture = new_picture(1, 1)\npicture\n") == (1, [])
    assert hidden("# %%\nplot_state(result)\n") == (1, [])
    for cell in ("picture = new_picture(1, 1)\nprint()\n", "plot_state(a)\nplot_state(b)\n", "shown = plot_state(a)\n"):
        assert len(hidden(f"# %%\n{cell}")[1]) == 1


@pytest.mark.full
def test_a_picture_shows_itself():
    picture = new_picture(2, 1)
    picture.add_subplot().plot([0, 1])
    assert picture._repr_png_().startswith(b"\x89PNG")
