"""Messages quote values in brief, however long they are."""

from __future__ import annotations

import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import poseppl
from poseppl.checks import check_at_least, check_choice
from poseppl.cli import main
from poseppl.errors import Argument, InputError, Location, Phrase, PosepplError, SettingError, brief, cut, worded

LONG = "a" * 30_000


def _nested() -> Any:
    value: Any = ()
    for _ in range(60):
        value = (value, value)
    return value


def test_values_are_quoted_in_brief() -> None:
    assert brief("knee") == "'knee'" and brief(1.5) == "1.5" and brief(None) == "None"
    assert brief(LONG) == f"'{LONG[:36]}...{LONG[:37]}'" or len(brief(LONG)) == 80
    assert brief(10**5000) == "an integer of 16610 bits" and brief(["x"] * 10**6) == "['x', 'x', 'x', 'x', 'x', 'x', ...]"
    for value in (LONG, LONG.encode(), {LONG: LONG}, [[LONG] * 9] * 9, _nested(), np.zeros(10**6), "\0" * 100):
        assert len(brief(value)) <= 80


def test_no_message_is_long() -> None:
    for length in range(3, 20):
        assert len(cut("0123456789" * 3, length)) == length
    error = InputError(LONG, file=LONG, line=3, field=LONG, expected=LONG)
    assert len(str(error)) < 3000 and ", line 3, " in str(error) and len(str(SettingError("name", LONG, LONG))) < 1500
    for check in (lambda: check_at_least(1, num_particles=LONG), lambda: check_choice(Any, rest=LONG)):
        with pytest.raises(ValueError, match="Expected") as raised:
            check()
        assert len(str(raised.value)) < 300


@pytest.mark.parametrize("words", [[LONG], ["filters", LONG], ["doctor", f"--{LONG}"]])
def test_the_command_line_repeats_no_long_word(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) in (1, 2)
    assert 0 < len(capsys.readouterr().err) < 2000


def test_messages_cut_values_by_one_function() -> None:
    """Slices in messages, and quoted values of files and options, leave out what is long without a word."""
    sliced = re.compile(r"\{[^{}]*\[:\d+\](?:!r)?\}")
    root = Path(poseppl.__file__).parent
    files = [file for part in ("files", "cli", "motion", "runs") for file in (root / part).rglob("*.py")]
    lines = [f"{file}: {line}" for file in files for line in file.read_text("utf-8").splitlines() if sliced.search(line)]
    assert not [line for line in lines if "hexdigest" not in line and "shape[:" not in line]


def test_messages_name_arguments_as_data() -> None:
    inner = Phrase("late, and ", Argument("offset", 3.5), " sets it")
    error = Location("a.json").in_field(Argument("files")).error("no {frame}\n", Phrase("none; ", inner))
    assert str(error) == "a.json, files: no {frame}? (expected none; late, and offset=3.5 sets it)"
    assert (
        worded(error, lambda argument: f"<{argument.name}>")
        == "a.json, <files>: no {frame}? (expected none; late, and <offset> sets it)"
    )
    assert worded(pickle.loads(pickle.dumps(error)), str) == str(error)
    assert worded(PosepplError("plain"), repr) == "plain" and worded(3, repr) == "3" and type(worded(inner, str)) is str
    setting = SettingError("num_chains", "many", "expected a number")
    assert str(setting) == "num_chains='many': expected a number"
    assert worded(setting, lambda argument: f"{argument.name}={argument.value}") == "num_chains=many: expected a number"
