"""The finder of prose that is hard to read."""

from __future__ import annotations

from prose import findings, markdown_of, prose_of

PAGE = (
    """# The user is told in a heading

Errors are mended, and
    the user is told in code
told twice: `told` and [told here](told.md).

```python
told = 1
```

| told | in a table |

* """
    + " ".join(["word"] * 31)
    + """.
* Where it starts, it is wrong. What is right? A question.
* Short. """
    + " ".join(["word"] * 29)
    + """
"""
)


def test_words_fronted_and_long_sentences_are_found_in_prose_alone() -> None:
    found = list(findings(PAGE))
    assert [number for number, _ in found] == [3, 5, 5, 13, 14]
    problems = [problem for _, problem in found]
    assert "'mended': write correct, fix" in problems[0] and "a sentence of 31 words" in problems[3]
    assert problems[4].startswith("subject first: * Where it starts")


def test_text_cells_of_notebooks_keep_their_lines() -> None:
    script = "# %% [markdown]\n# Errors are mended.\n\n# %%\ntold = 1  # told\n"
    assert markdown_of(script).split("\n") == ["", "Errors are mended.", "", "", ""]
    assert [number for number, _ in findings(markdown_of(script))] == [2]


MODULE = '''"""Errors are mended.

    mended = mended        formula

Args:
    error: Of the data, mended.
"""

told = "told"  # told


def told():
    """Who is it? It is mended.

    >>> told()
    'told'
    """
'''


def test_docstrings_and_comments_of_modules_keep_their_lines() -> None:
    found = [(number, problem.split(":")[0]) for number, problem in findings(prose_of(MODULE))]
    assert found == [(1, "'mended'"), (6, "'mended'"), (6, "subject first"), (9, "'told'"), (13, "'mended'")]
