"""Arguments that findings and errors name, as options of the command line.

>>> as_option(Argument("walk", "learned")), as_option(Argument("num_chains", 50, setting=True))
('--walk learned', '--set num_chains=50')
>>> as_option(Argument("sigma_angle")), as_option(Argument("files"))
('--set sigma_angle', 'FILES')
"""

from __future__ import annotations

from poseppl.errors import Argument, cut, worded

BY_SET = ("sigma_position", "sigma_angle", "markers", "other_motion", "history_mib", "on_failure", "devices", "export")
"""Settings of a track that `--set` gives, as it gives those of the algorithm."""
POSITIONAL = ("files", "videos", "recording", "observations")
"""Arguments of commands that are no options."""


def as_option(argument: Argument) -> str:
    """An argument and its value as an option."""
    name, value = argument.name, argument.value
    if name in POSITIONAL:
        return name.upper()
    if argument.setting or name in BY_SET:
        return f"--set {name}" + ("" if value is None else f"={cut(value)}")
    return f"--{name.replace('_', '-')}" + ("" if value in (None, True) else f" {cut(value)}")


def as_options(message: object) -> str:
    """A message, or an error, that names options."""
    return worded(message, as_option)
