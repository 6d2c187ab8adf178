"""The user's cache folder, and users without one."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def test_a_command_needs_no_home() -> None:
    code = """
import os, pwd
def unknown(user):
    raise KeyError("uid not found")
pwd.getpwuid = unknown
from poseppl.cli import main
from poseppl.files.cache_folder import cache_folder
assert main(["--version"]) == 0
print(cache_folder("xla"))
"""
    environment = {name: value for name, value in os.environ.items() if name not in ("HOME", "XDG_CACHE_HOME")}
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, env=environment)
    folder = Path(done.stdout.splitlines()[-1])
    assert folder.parts[-3:] == (".cache", "poseppl", "xla") and not folder.parents[2].exists()
