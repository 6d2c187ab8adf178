"""`poseppl track videos`: silhouettes of a person in two videos, and what is said of files that do not fit."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

pytest.importorskip("cv2", reason="needs pip install 'poseppl[vision]'")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "motion" / "tracking"))
from breaking_filter import break_down
from silhouette_rooms import RECORDS, SIZE, masks_of, pose

from poseppl.cli import main
from poseppl.diagnostics import verdicts
from poseppl.motion.io import open_video, write_cameras, write_image, write_video
from poseppl.runs.results import load_result, provenance

FEW = ["--filter", "annealed", "--set", "num_particles=40", "--set", "num_layers=2", "--quiet"]


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Three frames of a gray person on a dark ground, seen by two cameras, with pictures of the ground alone."""
    folder = tmp_path_factory.mktemp("room")
    states = [pose() + t * np.r_[30.0, np.zeros(27)] for t in range(3)]
    drawn = [masks_of(state) for state in states]
    noise = np.random.default_rng(0).integers(20, 40, (SIZE[1], SIZE[0], 1), np.uint8).repeat(3, 2)
    for record in RECORDS:
        images = [np.where(masks[record.name][..., None] > 0, np.uint8(180), noise) for masks in drawn]
        write_video(folder / f"{record.name}.mp4", images, 30.0)
        write_image(folder / f"{record.name}_empty.png", noise)
    write_image(folder / "square.png", noise[:90, :90])
    write_cameras(folder / "Calib.toml", RECORDS)
    (folder / "scene").mkdir()
    (folder / "scene" / "scene.toml").touch()
    return folder


@pytest.fixture(scope="module", autouse=True)
def _cache():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAX_COMPILATION_CACHE_DIR", str(jax.config.jax_compilation_cache_dir))
        yield


def run(capsys, *words):
    """Exit status, and all that was printed."""
    status = main(["track", *map(str, words)])
    printed = capsys.readouterr()
    return status, " ".join((printed.out + printed.err).split())


def videos(room):
    return ["--video", room / "left.mp4", room / "right.mp4", "--calibration", room / "Calib.toml"]


def empty(room):
    return ["--background", *(f"{record.name}={room / record.name}_empty.png" for record in RECORDS)]


@pytest.fixture(scope="module")
def tracked(room, tmp_path_factory):
    """Output of the command for the two videos."""
    folder = tmp_path_factory.mktemp("tracked")
    assert main(["track", *map(str, [*videos(room), *empty(room), *FEW, "-o", folder / "seen.nc"])]) == 0
    return folder


@pytest.mark.full
def test_two_videos_are_tracked_and_drawn_over(room, tracked):
    result = load_result(tracked / "seen.nc")
    assert result["posterior"].sizes["frame"] == 3
    assert np.isfinite(result["summary"].dataset["markers_mean"].values).all()
    assert result["sample_stats/overlap"].dims == ("frame", "camera") and (result["sample_stats/overlap"] > 0.3).all()
    assert not any("Nothing was observed" in verdict.text for verdict in verdicts(result))
    assert {path.name for path in tracked.iterdir()} == {"seen.nc", "seen.png", "seen-left.mp4", "seen-right.mp4"}
    overlay = list(open_video(tracked / "seen-left.mp4", "left").images())
    assert len(overlay) == 3 and overlay[0].shape == (SIZE[1], SIZE[0], 3)
    plain = next(open_video(room / "left.mp4", "left").images())
    assert np.abs(overlay[0].astype(int) - plain).max() > 100  # something is drawn


@pytest.mark.full
def test_videos_are_smoothed_while_they_are_at_hand(room, tracked, tmp_path, capsys):
    words = [*videos(room), *empty(room), *FEW, "--smooth", "backward-simulation", "-o", tmp_path / "seen.nc"]
    assert run(capsys, *words)[0] == 0
    assert {path.name for path in tmp_path.glob("*.nc")} == {"seen.nc", "seen-backward-simulation.nc"}
    smoothed = load_result(tmp_path / "seen-backward-simulation.nc")
    assert provenance(smoothed)["smoother"] == "backward-simulation" and smoothed["posterior"].sizes["frame"] == 3
    status, told = main(["smooth", str(tracked / "seen.nc")]), " ".join(capsys.readouterr().err.split())
    assert status == 1 and "track it with --smooth METHOD" in told


@pytest.mark.full
def test_a_smoother_that_fails_costs_no_result(room, tmp_path, capsys):
    kalman = ["--filter", "kalman", "--quiet", "--smooth", "genealogy", "-o", tmp_path / "seen.nc"]
    status, told = run(capsys, *videos(room), *empty(room), *kalman)
    assert status == 1 and re.search("not smoothed, but the filter's result is written: .*'kalman' has no genealogy", told), (
        told
    )
    assert load_result(tmp_path / "seen.nc")["posterior"].sizes["frame"] == 3


@pytest.mark.full
@pytest.mark.parametrize(
    "change, words",
    [
        (["--smooth", "nuts"], "nuts.*trajectory"),
        (["--smooth", "laplace", "--prior", "walk.nc"], "--smooth laplace does not go with --prior.*forward-backward does"),
    ],
)
def test_smoothing_that_cannot_be_is_reported_before(room, capsys, change, words):
    status, told = run(capsys, *videos(room), *empty(room), *change)
    assert status in (1, 2) and re.search(words, told), told


@pytest.mark.full
def test_the_result_tells_how_silhouettes_were_found(tracked):
    found = provenance(load_result(tracked / "seen.nc"))["silhouettes"]
    assert found["noise"] == 80.0 and found["edges"] is False and found["background"]["refine"] is False
    assert found["plates"] == ["left", "right"] and found["masks"] == [] and found["facing"] is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda room: ["--video", room / "left.mp4"], "--calibration.*no calibration"),
        (lambda room: ["--video", f"middle={room}/left.mp4", *videos(room)[3:]], "'middle' has no calibration"),
        (lambda room: ["--video", room / "absent.mp4", *videos(room)[3:]], "absent.mp4"),
        (lambda room: [*videos(room), "--background", f"middle={room}/left_empty.png"], "no video of .*'middle'.*left, right"),
        (lambda room: [*videos(room), *empty(room), "--stature", "20"], "--stature.*500 to 2500"),
        (lambda room: [*videos(room), *empty(room), "--frames", "1:2:3"], "--frames.*A:B"),
        (lambda room: [*videos(room), "--background", f"left={room}/square.png"], "camera left.*90 x 90 pixels.*240 x 180"),
        (lambda room: [*videos(room), "--masks", f"middle={room}/left.mp4"], "--masks.*no video of .*'middle'.*left, right"),
        (lambda room: [*videos(room), "--masks", f"left={room}/square.png"], "camera left: the mask has 90 x 90 pixels"),
        (lambda room: ["--video", room / "scene", "--masks", room / "left.mp4"], "--masks.*has its own.*none with a scene"),
        (lambda room: [*videos(room), "--cameras", "2"], "--cameras is an option of poseppl track recording"),
        (lambda room: [*videos(room), *empty(room), "--facing", "middle"], "--facing.*no camera 'middle'.*left, right"),
        (
            lambda room: ["--stature", "1700"],
            "--stature is an option of poseppl track observations and keypoints and live and videos",
        ),
    ],
)
def test_what_does_not_fit_is_reported(room, tmp_path, capsys, change, words):
    status, text = run(capsys, *change(room), *FEW, "-o", tmp_path / "none.nc")
    assert status in (1, 2) and re.search(words, text), text
    assert not list(tmp_path.iterdir())


@pytest.mark.full
def test_masks_are_never_written_over(room, tmp_path, capsys):
    mask = tmp_path / "seen-left.mp4"  # the name of an overlay
    mask.write_bytes((room / "left.mp4").read_bytes())
    status, text = run(capsys, *videos(room), "--masks", f"left={mask}", *FEW, "-o", tmp_path / "seen.nc")
    assert status == 1 and re.search(r"seen-left\.mp4.*input", text), text
    assert mask.read_bytes() == (room / "left.mp4").read_bytes() and len(list(tmp_path.iterdir())) == 1


@pytest.mark.slow
def test_a_video_that_ends_early_ends_the_run_with_a_note(room, tmp_path, capsys):
    images = list(open_video(room / "right.mp4", "right").images(0, 2))
    write_video(tmp_path / "right.mp4", images, 30.0)
    words = ["--video", room / "left.mp4", tmp_path / "right.mp4", "--calibration", room / "Calib.toml"]
    status, text = run(capsys, *words, *empty(room), *FEW, "-o", tmp_path / "short.nc")
    assert status == 0 and "right" in text and "2 frames" in text, text
    assert load_result(tmp_path / "short.nc")["posterior"].sizes["frame"] == 2


@pytest.mark.full
def test_a_person_who_leaves_is_predicted_or_stops_the_run(room, tmp_path, capsys):
    for record in RECORDS:
        images = list(open_video(room / f"{record.name}.mp4", record.name).images())
        nobody = next(open_video(room / f"{record.name}_empty.png", record.name).images())
        write_video(tmp_path / f"{record.name}.mp4", [*images[:2], nobody], 30.0)
    words = ["--video", tmp_path / "left.mp4", tmp_path / "right.mp4", "--calibration", room / "Calib.toml", *empty(room), *FEW]
    status, text = run(capsys, *words, "-o", tmp_path / "gone.nc")
    assert status == 0, text
    assert re.search("camera left, frame 2.*does not count", text) and re.search("camera right, frame 2", text), text
    found = load_result(tmp_path / "gone.nc")["summary"].dataset["markers_mean"].values
    assert len(found) == 3 and np.isfinite(found).all()
    status, text = run(capsys, *words, "--set", "on_failure=stop", "-o", tmp_path / "stopped.nc")
    assert status == 1 and re.search("camera left, frame 2.*no foreground", text), text
    assert not (tmp_path / "stopped.nc").exists()


@pytest.mark.full
def test_a_frame_that_cannot_be_decoded_ends_the_run_or_stops_it(room, tmp_path, capsys):
    images = list(open_video(room / "left.mp4", "left").images())
    (tmp_path / "left").mkdir()
    for number, image in enumerate(images):
        write_image(tmp_path / "left" / f"{number:06d}.png", image)
    broken = tmp_path / "left" / "000002.png"
    broken.write_bytes(broken.read_bytes()[:60])
    words = ["--video", tmp_path / "left", room / "right.mp4", "--calibration", room / "Calib.toml", *empty(room), *FEW]
    status, text = run(capsys, *words, "-o", tmp_path / "short.nc")
    assert status == 0 and re.search("camera left, frame 2.*ends before this frame", text), text
    assert load_result(tmp_path / "short.nc")["posterior"].sizes["frame"] == 2
    status, text = run(capsys, *words, "--set", "on_failure=stop", "-o", tmp_path / "stopped.nc")
    assert status == 1 and re.search("camera left, frame 2", text), text
    assert not (tmp_path / "stopped.nc").exists()


@pytest.mark.slow
def test_frames_before_one_that_breaks_down_are_written(room, tmp_path, capsys, monkeypatch):
    break_down(monkeypatch, 2)
    status, text = run(capsys, *videos(room), *empty(room), "--filter", "breaking", "--quiet", "-o", tmp_path / "part.nc")
    assert status == 1 and "frame 2: the filter's state is not finite" in text and "2 of 3, are in " in text
    assert load_result(tmp_path / "part.nc")["posterior"].sizes["frame"] == 2
    assert sum(1 for _ in open_video(tmp_path / "part-left.mp4").images()) == 2


@pytest.mark.full
def test_silhouettes_are_not_smoothed_from_a_file(tracked, capsys):
    status = main(["smooth", str(tracked / "seen.nc"), "--quiet"])
    assert status == 1 and "comes from silhouettes" in " ".join(capsys.readouterr().err.split())
