"""Words of the command line are checked before anything heavy is imported."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import get_args

import click
import pytest
from waiting import PATIENCE

from poseppl.cli import cli, main
from poseppl.cli.checks import InputFile
from poseppl.cli.track import track
from poseppl.motion.io import keypoint_layouts
from poseppl.motion.io.keypoints import DETECTORS
from poseppl.motion.keypoints.settings import Detector, Layout

pytestmark = pytest.mark.usefixtures("here")

KEYPOINTS = "track keypoints a=k.json --calibration c.toml"
MODEL = "run m.py --data d.csv"
REFUSED = {
    "track no.c3d": "no.c3d: no such file",
    "track empty.bvh": "empty.bvh: the file is empty",
    "track a.bvh --skeleton no.asf": "no.asf: no such file",
    "track a.bvh -o absent/x.nc": "absent: the output folder does not exist",
    "track a.bvh -o a.txt": "a.txt, --output: not a name",
    "track --checkpoint a.bvh/run": "--checkpoint: not a folder",
    "track --filter kalmann": "'kalmann' is no filter (expected kalman)",
    "track --set num_chains=5": "--set num_chains=5: no setting of the filter kalman",
    "track --prior r.nc --set num_chains=5": "--set num_chains=5: no setting of the filter switching",
    f"{KEYPOINTS} --set window=5": "--set window=5: no setting of the filter assumed-density",
    "track --filter hmc --set target_acceptance=much": "--set target_acceptance=much: expected a number, or none",
    "track --filter particle --set resampling=x": "--set resampling=x: expected one of systematic, stratified",
    "track --smooth no": "'no' is no smoother",
    "track --model no.py:body": "no.py: no such file",
    "track --model nopackage.x:body": "--model: no package 'nopackage'",
    "track --frames x": "--frames: 'x'",
    "track --rate nan": "--rate: nan",
    "track --noise 0": "--noise: 0",
    "track --camera no.toml": "no.toml: no such file",
    "track w.amc": "w.amc: an .amc file needs its skeleton",
    "track recording k.json": "k.json: unknown format '.json'",
    "track keypoints k.json --calibration c.toml": "FILES: 'k.json' (expected CAMERA=FILE",
    "track points a=k.json --calibration no.toml": "no.toml: no such file",
    "track live a=folder --calibration c.toml --detector sleap": "--detector: live folders have one file a frame",
    "track observations no.csv --camera c.toml": "no.csv: no such file",
    "track --set markers=no": "--set markers=no: expected one of fixed, learned",
    "track --set devices=0": "--set devices: 0 (expected at least 1)",
    "track --keypoints a=no.json --calibration c.toml": "no.json: no such file",
    f"{KEYPOINTS} --detector x": "--detector: 'x'",
    f"{KEYPOINTS} --layout x": "--layout: 'x'",
    f"{KEYPOINTS} --unit x": "--unit: 'x'",
    f"{KEYPOINTS} --camera a:offset=b": "--camera: 'b'",
    f"{KEYPOINTS} --camera a:rate=5": "--camera: a camera's rate needs that of the others, --rate",
    f"{KEYPOINTS} --camera a:size=5": "--camera: 'a:size=5'",
    f"{KEYPOINTS} --camera a:gain=5": "--camera: 'a:gain=5'",
    f"{KEYPOINTS} --keep times": "--keep: 'times'",
    f"{KEYPOINTS} --noise no.json": "no.json: no such file",
    "track --video no.mp4 --calibration c.toml": "no.mp4: no such file",
    "track --video a.bvh": "--calibration: no calibration",
    "run m.py --data no.csv": "no.csv: no such file",
    "run no.py --data d.csv": "no.py: no such file",
    f"{MODEL} --settings no.toml": "no.toml: no such file",
    f"{MODEL} --set x=1": "--set x=1: no setting of the filter particle",
    f"{MODEL} --smooth x": "'x' is no smoother",
    f"{MODEL} --fit no.nc": "no.nc: no such file",
    "fit no.py --data d.csv": "no.py: no such file",
    "fit m.py --data d.csv --method mle": "'mle' is no method (expected ml)",
    "fit m.py --data d.csv --set num_draws=5": "--set num_draws=5: no setting of the method ml (expected num_starts",
    "fit m.py --data d.csv --filter kalman --filter-set x=1": "--set x=1: no setting of the filter kalman",
    "batch no --model m.py": "no: no such folder",
    "batch folder --model no.py": "no.py: no such file",
    "smooth no.nc": "no.nc: no such file",
    "smooth r.nc --method viterbi --set a=1": "--set a=1: no setting of the smoother viterbi (expected tile)",
    "report no.nc": "no.nc: no such file",
    "export r.nc --output no": "no, --output: not a folder",
    "overlay r.nc a=no.mp4": "no.mp4: no such file",
    "compare r.nc b=no.nc": "no.nc: no such file",
    "simulate no.bvh": "no.bvh: no such file",
    "simulate --turn 10": "--turn: 10",
    "fit-gait no.bvh": "no.bvh: no such file",
    "fit-motion walk a.bvh,no.asf": "no.asf: no such file",
    "calibrate-detector x --keypoints a=no.json --calibration c.toml": "no.json: no such file",
    "reproduce choo-fleet-2001 --motion walk=no.amc": "no.amc: no such file",
    "reproduce choo-fleet-2001 -o a.bvh": "--folder: not a folder",
    "filters no": "'no' is no filter",
}
USAGE = {
    "dance": "No such command 'dance'",
    "track --num-chains 5": "--set num_chains=",
    "track --sigma-angle 5": "--set sigma_angle=",
    "track --person 2": "--person is an option of poseppl track keypoints and live and points",
    "track k.json": "Missing option '--calibration'",
    "fit m.py --data d.csv --num-draws 5": "--set num_draws=",
    "reproduce choo-fleet-2001 no": "no part 'no'; its parts are single-frame",
}
EVERY_COMMAND = """
import contextlib, io, json, sys
from poseppl.cli import main
heavy, told = {"jax", "numpy", "scipy", "xarray", "numpyro", "matplotlib", "arviz", "h5py"}, {}
for line in json.loads(sys.argv[1]):
    with contextlib.redirect_stderr(io.StringIO()) as message, contextlib.redirect_stdout(io.StringIO()):
        status = main(line.split())
    told[line] = status, message.getvalue(), sorted(heavy & set(sys.modules))
print(json.dumps(told))
"""


@pytest.fixture
def files(here: None) -> None:
    for name in ("a.bvh", "w.amc", "k.json", "c.toml", "r.nc", "m.py", "d.csv"):
        Path(name).write_text("x\n")
    Path("empty.bvh").touch()
    Path("folder").mkdir()


def run(code: str, *arguments: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], check=True, capture_output=True, text=True, timeout=PATIENCE
    ).stdout


@pytest.mark.usefixtures("files")
def test_nothing_heavy_is_loaded_before_words_are_refused() -> None:
    right = [
        "--help",
        "track --help",
        *(f"track {source} --help" for source in track.commands),
        "reproduce",
        "filters",
        "smoothers trajectory",
        "methods nuts",
    ]
    told = json.loads(run(EVERY_COMMAND, json.dumps([*REFUSED, *USAGE, *right])))
    for lines, expected in ((REFUSED, 1), (USAGE, 2), (dict.fromkeys(right, ""), 0)):
        for line, words in lines.items():
            status, message, loaded = told[line]
            assert (status, loaded) == (expected, []) and words in message, (line, status, message, loaded)


def test_a_missing_file_is_reported_at_once() -> None:
    """Processor time, of which another process takes none; importing JAX and ArviZ takes 3 seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-m", "poseppl.cli", "track", "no.c3d"], check=False, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert "no.c3d: no such file" in done.stderr and done.returncode == 1
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 0.7


def test_a_file_that_must_not_be_read(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may read every file, so that the system's answer is given here."""
    Path("a.nc").write_text("x")
    monkeypatch.setattr(os, "access", lambda path, mode: not (str(path) == "a.nc" and mode == os.R_OK))
    assert main(["report", "a.nc"]) == 1
    assert "a.nc, RESULT: cannot be read: Permission denied" in capsys.readouterr().err


def test_every_file_that_is_read_is_checked() -> None:
    """Other paths are those of outputs, and the folders of batch, which looks for tables or trials in them."""
    others = {
        f"{command.name} {parameter.name}"
        for command in (*cli.commands.values(), *track.commands.values(), *cli.commands["batch"].commands.values())
        for parameter in command.params
        if isinstance(parameter.type, click.Path) and not isinstance(parameter.type, InputFile)
    }
    assert others == {
        "keypoints folder",
        "tables folder",
        "demo folder",
        "export output",
        "gait output",
        "fit-motion plot",
        "overlay output",
        "reproduce folder",
        *(f"{source} checkpoint" for source in ("keypoints", "observations", "recording", "videos")),
    }


def test_layouts_and_detectors_are_those_of_the_reader() -> None:
    assert get_args(Layout) == tuple(keypoint_layouts.LAYOUTS) and get_args(Detector) == tuple(DETECTORS)
