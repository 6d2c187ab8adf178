"""`poseppl track`: its sources, found from files where none is named, and options that are the fields of settings."""

from __future__ import annotations

import ast
import re
from dataclasses import FrozenInstanceError, fields, replace
from pathlib import Path
from typing import Any

import click
import pytest

import poseppl
from poseppl.cli import main
from poseppl.cli.checks import files_read
from poseppl.cli.options import BY_SET, POSITIONAL, as_options, text_of
from poseppl.cli.track import OF_TRACK, by_set, track
from poseppl.cli.track_dispatch import dispatched, source_of_file
from poseppl.errors import InputError
from poseppl.motion import (
    KeypointSettings,
    LiveSettings,
    ObservationSettings,
    PointSettings,
    RecordingSettings,
    TrackSettings,
    VideoSettings,
)
from poseppl.motion.io.camera_fields import CameraRecord
from poseppl.motion.settings import OneCamera, read_cameras

SETTINGS: dict[str, Any] = {
    "recording": RecordingSettings,
    "observations": ObservationSettings,
    "keypoints": KeypointSettings,
    "live": LiveSettings,
    "points": PointSettings,
    "videos": VideoSettings,
}
MOST = 25
"""Options of a source, without --help."""
FILES = {
    "table.csv": "frame,marker,x,y\n0,knee_l,1,2\n",
    "person.csv": "scorer,a,a,a\nbodyparts,left_knee,left_knee,left_knee\n",
    "fly.csv": "scorer,a,a,a\nbodyparts,L1A,L1A,L1A\n",
    "caliscope.csv": "sync_index,point_id,img_loc_x\n",
    "k.json": "{}",
    "pose/000.json": "{}",
    "pictures/000.png": "",
    "room/scene.toml": "",
    "a=b.bvh": "",
}


@pytest.fixture
def files(here: None) -> None:
    for name, text in FILES.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(text)


@pytest.mark.usefixtures("files")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("", "recording"),
        ("--cameras 2 -q", "recording --cameras 2 -q"),
        ("-q walk.bvh --cameras 2", "recording -q walk.bvh --cameras 2"),
        ("--model pose/000.json walk.bvh", "recording --model pose/000.json walk.bvh"),
        ("--model=k.json w.amc --skeleton w.asf", "recording --model=k.json w.amc --skeleton w.asf"),
        ("absent.csv", "recording absent.csv"),
        ("a=b.bvh", "recording a=b.bvh"),
        ("table.csv --camera c.toml", "observations table.csv --camera c.toml"),
        ("--observations t.csv --camera c.toml", "observations t.csv --camera c.toml"),
        ("--observations=t.csv --camera c.toml", "observations t.csv --camera c.toml"),
        (
            "--camera-rate 2 cam1=pose cam2=pose --calibration c.toml",
            "keypoints --camera-rate 2 cam1=pose cam2=pose --calibration c.toml",
        ),
        ("k.json", "keypoints k.json"),
        ("--keypoints a=pose --calibration c.toml", "keypoints a=pose --calibration c.toml"),
        ("a=person.csv --calibration c.toml", "keypoints a=person.csv --calibration c.toml"),
        ("--keypoints a=pose --live --calibration c.toml", "live a=pose --calibration c.toml"),
        ("--live a=pose --calibration c.toml", "live a=pose --calibration c.toml"),
        ("a=fly.csv b=fly.csv --calibration c.toml", "points a=fly.csv b=fly.csv --calibration c.toml"),
        ("a=caliscope.csv --calibration c.toml", "points a=caliscope.csv --calibration c.toml"),
        ("--keypoints a=k.json --skeleton s.toml", "points a=k.json --skeleton s.toml"),
        ("a=fly.csv b=person.csv", "keypoints a=fly.csv b=person.csv"),
        ("--video a.mp4 b.mp4 --background x.png y.png", "videos a.mp4 b.mp4 --background x.png y.png"),
        ("front=a.MP4", "videos front=a.MP4"),
        ("pictures", "videos pictures"),
        ("room", "videos room"),
    ],
)
def test_the_source_is_found_from_the_files(words: str, expected: str) -> None:
    assert dispatched(words.split(), ("-q", "--live")) == expected.split()


def test_the_first_word_of_a_command_is_not_looked_up(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["track", "-h"], ["track", "--help"]):
        assert main(words) == 0 and "keypoints" in capsys.readouterr().out
    assert main(["track", "walk.bvh", "--help"]) == 0
    assert "Usage: poseppl track recording" in capsys.readouterr().out


@pytest.mark.parametrize("source", SETTINGS)
def test_options_are_fields_of_settings(source: str) -> None:
    """Each field is an option or the argument; each option has the text of its field, and a default."""
    command, kind = track.commands[source], SETTINGS[source]
    options = [each for each in command.params if isinstance(each, click.Option)]
    named = {str(option.name) for option in options}
    own = [each.name for each in fields(kind)]
    assert set(own) - named == {own[0]} <= set(POSITIONAL) and len(options) <= MOST
    for option in options:
        assert option.help and option.help[0].isupper() and "Default:" not in option.help, option.name
        shown = option.is_flag or option.required or "[default: " in option.help
        assert shown or option.name == "settings", option.name
    texts = {option.name: option.help or "" for option in options}
    for name in own[1:]:
        assert texts[name].startswith(text_of(kind, name).partition(" Default: ")[0]), name


def test_every_setting_of_a_track_is_given_by_some_option() -> None:
    others = {"model", "options", "chunk"}  # of the source, of --set, and of Python alone
    assert {each.name for each in fields(TrackSettings)} == {*OF_TRACK, *BY_SET, *others} - {"export"}
    for source in SETTINGS.keys() - {"points"}:
        for setting in by_set(track.commands[source]):
            assert setting.text.endswith((".", "]")) and setting.read(setting.default) == setting.default


def test_settings_check_their_values() -> None:
    for wrong, told in (
        (lambda: RecordingSettings(cameras=5), "cameras: 5 (expected 1 to 4)"),
        (lambda: RecordingSettings(noise=float("nan")), "noise: nan (expected a positive fraction"),
        (lambda: RecordingSettings(skeleton="a.asf"), "skeleton: the built-in walk takes none"),
        (lambda: RecordingSettings("a.bvh", camera="c.toml", view=0.0), "view: cameras come from the file (expected no camera"),
        (lambda: ObservationSettings("a.csv", "c.toml", stature=20), "stature: 20 (expected 500 to 2500 mm)"),
        (lambda: ObservationSettings("a.csv", "c.toml", frames="5:2"), "frames: '5:2' has no frame"),
        (lambda: KeypointSettings({}, "c.toml", noise=0.0), "noise: 0 (expected a positive fraction"),
        (lambda: KeypointSettings({}, "c.toml", keep=("times",)), "keep: 'times' (expected one of clocks"),  # type: ignore[arg-type]
        (lambda: KeypointSettings({}, "c.toml", camera={"a": OneCamera(rate=50.0)}), "camera: a camera's rate needs"),
        (lambda: KeypointSettings({}, "c.toml", unit="feet"), "unit: 'feet' (expected mm, cm"),
        (lambda: PointSettings({}, "c.toml", camera=("a:rate=5",)), "camera: frames with the same number"),
        (lambda: VideoSettings(("a.mp4",)), "calibration: no calibration"),
        (lambda: TrackSettings(walk="learnt"), "walk: 'learnt' (expected one of fixed, learned, mean-reverting)"),  # type: ignore[arg-type]
        (lambda: TrackSettings(seed="3"), "seed: '3' (expected 0 to 4294967295)"),  # type: ignore[arg-type]
    ):
        with pytest.raises(InputError, match=f"^{re.escape(told)}"):
            wrong()
    with pytest.raises(FrozenInstanceError):
        TrackSettings().seed = 3  # type: ignore[misc]


def test_words_of_cameras() -> None:
    found = read_cameras(["a:offset=-2.5,size=960x540", "a:rate=30", "front:left:offset=1"])
    assert found == {"a": OneCamera(-2.5, 30.0, (960, 540)), "front:left": OneCamera(1.0)}
    for word in ("a", "a:", "a:offset", "a:offset=1,offset=2", "a:size=0x5", "a:size=5", ":rate=3", "a:rate=1e10"):
        with pytest.raises(InputError, match="^camera: "):
            read_cameras([word])


def test_files_that_are_read() -> None:
    """The first names the result; a camera's name is no part of a path, and a noise is a number or a file."""
    videos = VideoSettings(("front=a.mp4", "b.mp4"), "c.toml", background=("front=empty.png",))
    assert list(files_read(videos)) == ["a.mp4", "b.mp4", "c.toml", "empty.png"]
    keypoints = KeypointSettings({"a": "pose/a"}, "c.toml", noise=0.003, lengths="l.toml")
    assert list(files_read(keypoints)) == ["pose/a", "c.toml", "l.toml"]
    assert list(files_read(replace(keypoints, noise="e.json")))[-1] == "e.json"
    assert list(files_read(RecordingSettings("x=y.bvh"))) == ["x=y.bvh"]


def test_errors_and_notes_name_options_on_the_command_line_alone(
    capsys: pytest.CaptureFixture[str], here: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(settings: Any) -> None:
        raise InputError(
            "nobody", field=poseppl.errors.Argument("files"), expected=poseppl.motion.io.units_and_axes.UNKNOWN_UNIT
        )

    monkeypatch.setattr("poseppl.motion.sources.scene_of_keypoints", refused)
    Path("pose").mkdir()
    Path("c.toml").write_text("x")
    assert main(["track", "keypoints", "a=pose", "--calibration", "c.toml"]) == 1
    told = "nobody (expected the calibration does not state its unit; metres are assumed"
    assert f"poseppl: FILES: {told} (--unit sets it))" in capsys.readouterr().err
    with pytest.raises(InputError, match="^" + re.escape(f"files: {told} (unit sets it))")):
        refused(None)
    assert as_options(CameraRecord) == str(CameraRecord)


def test_no_option_is_named_outside_of_the_command_line() -> None:
    """Messages of the toolkit and of motion name arguments as data; options of other programs are not ours."""
    root = Path(poseppl.__file__).parent
    option = re.compile(r"(?<![\w-])--(?!xla_)[a-z]")
    found = []
    for path in sorted(set(root.rglob("*.py")) - set((root / "cli").rglob("*.py"))):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        texts = set()
        if path.relative_to(root).parts[0] != "motion":  # where docstrings may name a command to run
            bodies = [node for node in ast.walk(tree) if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)]
            texts = {id(node.body[0].value) for node in bodies if node.body and isinstance(node.body[0], ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in texts:
                found += [f"{path}:{node.lineno}"] if option.search(node.value) else []
    assert found == []


def test_a_file_of_no_known_kind_is_no_detectors(tmp_path: Path) -> None:
    (tmp_path / "notes.md").write_text("# Notes\n", encoding="utf-8")
    assert source_of_file(str(tmp_path / "notes.md")) == "recording"
