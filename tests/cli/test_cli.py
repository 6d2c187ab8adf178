"""The command line: help, files, bad input, interruption."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from waiting import PATIENCE, wait_until

from poseppl.cli import main
from poseppl.cli.track import track
from poseppl.motion import RecordingSettings, TrackSettings, track as track_source
from poseppl.motion.io.motion import Motion
from poseppl.motion.io.trc import write_trc
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.silhouettes.video_sources import read_scene_truth
from poseppl.runs.results import load_result, provenance

pytestmark = pytest.mark.usefixtures("here")

SMALL = ["--filter", "particle", "--set", "num_particles=200", "--frames", "0:4", "--max-draws", "20"]


def refused(capsys: pytest.CaptureFixture[str], arguments: list[str], *words: str, status: int = 1) -> str:
    """Run, and expect one clear message on stderr and no file."""
    before = sorted(Path().rglob("*"))
    assert main(arguments) == status
    message = capsys.readouterr().err
    assert "Traceback" not in message
    for word in words:
        assert word in message
    if status == 1:
        assert len(message.strip().splitlines()) == 1 and message.startswith("poseppl: ")
    assert sorted(Path().rglob("*")) == before
    return message


def test_track_report_simulate(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["track", *SMALL]) == 0
    printed = capsys.readouterr()
    for words in ("mean joint error", "frames a second", "poseppl-walk.nc"):
        assert words in printed.out
    assert sorted(path.name for path in Path().iterdir()) == ["poseppl-walk.nc", "poseppl-walk.png"]
    tree = load_result("poseppl-walk.nc")
    assert tree["posterior"].sizes["frame"] == 4
    how = TrackSettings(filter="particle", options={"num_particles": 200}, max_draws=20)
    same = track_source(RecordingSettings(frames="0:4"), how).result["posterior/markers"]
    np.testing.assert_array_equal(tree["posterior/markers"].to_numpy(), same.to_numpy())
    assert main(["report", "poseppl-walk.nc"]) == 0
    assert "<!DOCTYPE html>" in Path("poseppl-walk.html").read_text()[:20]
    assert main(["smooth", "poseppl-walk.nc", "--method", "forward-backward", "-q"]) == 0
    smoothed = load_result("poseppl-walk-forward-backward.nc")
    assert smoothed["posterior"].sizes["frame"] == 4
    assert (
        smoothed["unconstrained_posterior"]["state_dim"].values.tolist()
        == tree["unconstrained_posterior"]["state_dim"].values.tolist()
    )
    Path("sim").mkdir()
    assert main(["simulate", "--frames", "0:3", "-o", "sim", "--quiet"]) == 0
    assert sorted(path.suffix for path in Path("sim").iterdir()) == [".csv", ".nc", ".toml"]


def test_a_gait_is_fitted_with_so_many_harmonics() -> None:
    walker = walking_subject(frames="0:48")
    motion = Motion(walker.body.tree.marker_names, walker.markers, (), walker.rate, "walk")
    write_trc("walk.trc", motion, walker.frames / walker.rate, walker.frames)
    assert main(["fit-gait", "walk.trc", "--harmonics", "2", "-o", "gait.json", "--quiet"]) == 0
    gait = json.loads(Path("gait.json").read_text())
    assert gait["period"] == pytest.approx(1.1, abs=0.02)
    assert {len(row) for row in gait["coefficients"].values()} == {1 + 2 * 2}


@pytest.mark.full
def test_a_walk_is_laid_along_a_circle() -> None:
    for name, turn in (("straight", []), ("left", ["--turn", "900"]), ("right", ["--turn", "-900"])):
        assert main(["simulate", "--frames", "0:46:15", "-q", "-o", f"{name}.csv", *turn]) == 0
    straight, left, right = (read_scene_truth(f"{name}.nc").states for name in ("straight", "left", "right"))
    assert left[-1, 3] - straight[-1, 3] > 1.2 and right[-1, 3] - straight[-1, 3] < -1.2
    for bent in (left, right):
        assert bent[:, 4:].tolist() == straight[:, 4:].tolist() and bent[0] == pytest.approx(straight[0])
    # it heads along +x: left is +y
    assert left[-1, 1] > straight[-1, 1] + 500 and right[-1, 1] < straight[-1, 1] - 500


@pytest.mark.usefixtures("here", "without_pictures")
@pytest.mark.slow
def test_the_random_walk_is_the_one_that_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(
            ["track", *SMALL, "-q", "--frames", "0:1", "--rate", "60", "--set", "sigma_position=30", "--set", "sigma_angle=0.3"]
        )
        == 0
    )
    tree = load_result("poseppl-walk.nc")
    steps = tree["inputs/step_scale"].values * 60**0.5
    assert steps[:, 0] == pytest.approx(30.0) and steps[:, -1] == pytest.approx(0.3)
    assert main(["track", *SMALL, "-q", "--rate", "60", "--walk", "learned"]) == 0
    learned = load_result("poseppl-walk.nc")
    assert provenance(learned)["settings"]["walk"] == "learned"
    assert len(set(learned["inputs/step_scale"].values[1].tolist())) > 5
    Path("seen").mkdir()
    assert main(["simulate", "--frames", "0:1", "-o", "seen", "-q"]) == 0
    files = ["--observations", "seen/poseppl-walk.csv", "--camera", "seen/poseppl-walk.toml", "-o", "seen.nc"]
    capsys.readouterr()
    assert main(["track", *files, *SMALL[:4], "-q"]) == 0
    assert "30 frames a second are assumed (--rate)" in capsys.readouterr().err
    assert main(["track", *files, *SMALL[:4], "-q", "--rate", "120"]) == 0
    assert "are assumed" not in capsys.readouterr().err
    halved = load_result("seen.nc")["inputs/step_scale"].values
    assert halved[:, 0] == pytest.approx(7.5) and halved[:, -1] == pytest.approx(0.075)
    refused(capsys, ["track", *files, "--rate", "0"], "--rate")


@pytest.mark.full
@pytest.mark.usefixtures("here", "without_pictures")
def test_smoothing_that_cannot_be_done(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["track", *SMALL, "-q"]) == 0
    capsys.readouterr()
    refused(capsys, ["smooth", "poseppl-walk.nc", "--set", "num_draw=5"], "--set num_draw=5", "num_draws")
    refused(
        capsys,
        ["smooth", "poseppl-walk.nc", "--method", "viterbi", "--set", "a=1"],
        "--set a=1: no setting of the smoother viterbi (expected tile)",
    )
    refused(capsys, ["smooth", "poseppl-walk.nc", "-o", "poseppl-walk.nc"], "poseppl-walk.nc")
    refused(capsys, ["smooth", "absent.nc"], "absent.nc")


@pytest.mark.full
@pytest.mark.usefixtures("here", "without_pictures")
def test_checkpoint_and_resume(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["track", *SMALL, "--checkpoint", "run", "--quiet"]
    assert main(arguments) == 0
    capsys.readouterr()
    refused(capsys, arguments, "resume it (--resume)")
    refused(capsys, [*arguments, "--resume", "--seed", "1"], "another run")
    assert main([*arguments, "--resume", "-o", "again.nc"]) == 0
    first, second = load_result("poseppl-walk.nc"), load_result("again.nc")
    assert first["posterior"].dataset.equals(second["posterior"].dataset)


@pytest.mark.full
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["track", "--noise", "-1"], ["--noise"]),
        (["track", "--noise", "nan"], ["--noise"]),
        (["track", "--filter", "hmc", "--set", "num_chains=0"], ["--set num_chains=0: expected at least 1"]),
        (["track", "--filter", "hmc", "--set", "num_chains=many"], ["--set num_chains=many: expected a whole number"]),
        (["track", "--filter", "kalmann"], ["'kalmann' is no filter (expected kalman)"]),
        (["track", "--set", "sigma_angle=-0.1"], ["--set sigma_angle: -0.1"]),
        (["track", "--rate", "0"], ["--rate"]),
        (["track", "--seed", "-1"], ["--seed", "0 to 4294967295"]),
        (["track", "--frames", "5:2"], ["frames", "5:2"]),
        (["track", "--frames", "x"], ["frames"]),
        (["track", "--cameras", "9"], ["--cameras", "1 to 4"]),
        (["track", "--camera-distance", "-5"], ["--camera-distance"]),
        (["track", "--skeleton", "a.asf"], ["--skeleton"]),
        (
            ["track", "--filter", "hmc", "--set", "chains=5"],
            ["--set chains=5: no setting of the filter hmc (expected num_chains)"],
        ),
        (["smoothers", "gibs"], ["'gibs' is no smoother (expected gibbs)"]),
        (["track", "--model", "nothing"], ["--model"]),
        (["track", "--model", "poseppl_models.sminchisescu_triggs.marker_body:arm"], ["--model", "28 coordinates"]),
        (["track", "--model", "poseppl_models.bodies.choo_fleet:leg"], ["--model", "full_body"]),
        (["track", "absent.bvh"], ["absent.bvh", "no such file"]),
        (["track", "walk.csv"], ["walk.csv", ".amc or .bvh or .c3d or .trc or .txt"]),
        (["track", "-o", "absent/x.nc"], ["absent", "does not exist"]),
        (["track", "-o", "x.txt"], ["--output", "NAME.nc"]),
        (["simulate", "--missing", "1"], ["--missing"]),
        (["simulate", "--focal", "-3"], ["--focal"]),
        (["simulate", "--turn", "299"], ["--turn", "at least 300 mm"]),
        (["report", "absent.nc"], ["absent.nc", "no such file"]),
        (["fit-motion", "walk", "absent.bvh"], ["absent.bvh", "no such file"]),
        (["fit-motion", "walk", "absent_01.amc"], ["absent_01.amc", "no such file"]),
        (["fit-motion", "walk", "absent.bvh", "--rate", "-1"], ["--rate"]),
        (["fit-motion", "absent/walk", __file__], ["absent", "does not exist"]),
        (["reproduce", "choo-fleet-2001", "--motion", "walk.amc"], ["--motion", "NAME=FILE"]),
        (["reproduce", "choo-fleet-2001", "--motion", "walk=absent.amc"], ["absent.amc", "no such file"]),
    ],
)
def test_bad_input_ends_with_one_message(capsys: pytest.CaptureFixture[str], arguments: list[str], words: list[str]) -> None:
    refused(capsys, arguments, *words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["track", "--set", "num_chains"], ["--set", "NAME=VALUE"]),
        (["track", "--particles", "5"], ["--particles", "--set num_particles="]),
        (["smooth", "a.nc", "--draws", "5"], ["--draws", "--set num_draws="]),
        (["track", "--colour"], ["--colour"]),
        (["dance"], ["dance"]),
        (["smooth", "a.nc", "--max-draws", "0"], ["--max-draws"]),
        (["fit-gait", "absent.amc", "--harmonics", "0"], ["--harmonics"]),
        (["reproduce", "choo-fleet-2001", "--workers", "0"], ["--workers"]),
        (["batch", "a", "--model", "m.py", "--workers", "2", "--scheduler", "tcp://h:1"], ["--workers does not go with"]),
        (["reproduce", "choo-fleet-2001", "--scheduler", "tcp://h:1", "--workers", "2"], ["--workers does not go with"]),
        (["track", "--resume"], ["--resume needs --checkpoint"]),
        (["reproduce", "choo-fleet-2001", "tables"], ["no part 'tables'", "single-frame"]),
        (["track", "--observations", "a.csv"], ["Missing option '--camera'"]),
        (["track", "a.bvh", "--observations", "a.csv", "--camera", "c.toml"], ["unexpected extra argument (a.csv)"]),
    ],
)
def test_wrong_usage_exits_with_2(capsys: pytest.CaptureFixture[str], arguments: list[str], words: list[str]) -> None:
    refused(capsys, arguments, *words, status=2)


def test_recordings_that_cannot_be_used(capsys: pytest.CaptureFixture[str], data_dir: Path) -> None:
    amc, asf = data_dir / "cmu_amc" / "02_01.amc", str(data_dir / "cmu_amc" / "02.asf")
    refused(capsys, ["track", str(amc)], "--skeleton")
    refused(capsys, ["track", str(amc), "--skeleton", asf, "--frames", "0:9999"], "out of range", "0:343")
    refused(capsys, ["track", str(data_dir / "btk_c3d" / "Dance.c3d")], "Dance.c3d")
    Path("cut.amc").write_bytes(amc.read_bytes()[:5000])
    refused(capsys, ["track", "cut.amc", "--skeleton", asf], "cut.amc", "line")
    Path("empty.csv").write_text("")
    refused(capsys, ["track", "--observations", "empty.csv", "--camera", asf], "empty.csv: the file is empty")


def test_an_input_is_never_overwritten(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--frames", "0:3", "--quiet"]) == 0
    Path("points.nc").write_bytes(Path("poseppl-walk.csv").read_bytes())
    arguments = ["track", "--observations", "points.nc", "--camera", "poseppl-walk.toml", "-o", "points.nc"]
    refused(capsys, arguments, "would overwrite an input")


def test_unexpected_faults_show_where_with_debug(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*args: Any, **kwargs: Any) -> None:
        raise RuntimeError("a fault")

    monkeypatch.setattr("poseppl.cli.track_run._tracked", broken)
    refused(capsys, ["track"], "unexpected RuntimeError: a fault", "--debug")
    assert main(["track", "--debug"]) == 1
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.full
@pytest.mark.parametrize(("sent", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, -signal.SIGTERM)])  # 143 in a shell
def test_a_run_that_is_stopped_tidies_up_and_says_how_to_go_on(sent: signal.Signals, status: int) -> None:
    command = [sys.executable, "-c", "import sys; from poseppl.cli import main; sys.exit(main())"]
    arguments = ["track", *SMALL, "--frames", "0:5000", "--checkpoint", "run"]
    process = subprocess.Popen([*command, *arguments], stderr=subprocess.PIPE, text=True)
    wait_until(lambda: list(Path("run").glob("part-*")), process=process)
    process.send_signal(sent)
    _, message = process.communicate(timeout=PATIENCE)
    assert process.returncode == status
    assert "Traceback" not in message and "interrupted" in message and "--resume" in message
    assert [path.name for path in Path().iterdir()] == ["run"] and not list(Path("run").glob(".*"))


@pytest.mark.parametrize(
    "command",
    [
        [],
        *(
            [name]
            for name in ("track", "smooth", "filters", "smoothers", "simulate", "report", "export", "compare", "reproduce")
        ),
        ["fit-gait"],
    ]
    + [["fit-motion"], ["calibrate-detector"], ["doctor"], *(["track", source] for source in track.commands)],
)
def test_help_reads_like_a_manual_page(capsys: pytest.CaptureFixture[str], command: list[str]) -> None:
    assert main([*command, "--help"]) == 0
    text = capsys.readouterr().out
    assert "Usage: poseppl" in text and "Examples:" in text and "xit status" in text
    if command:
        assert "Files written" in text
        for option in re.findall(r"^  (?:-\w, )?--[\w/ -]+", text, re.MULTILINE):
            assert option.strip()
