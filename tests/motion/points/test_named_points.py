"""Named points: where they start, the prior that params are sought under, what hangs together, what is read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.compilation import double_precision
from poseppl.errors import InputError
from poseppl.motion.geometry import join_cameras, look_at, project
from poseppl.motion.io import CameraRecord, read_cameras
from poseppl.motion.io.skeleton_files import Link, Skeleton
from poseppl.motion.points.files import read_point_recording
from poseppl.motion.points.fit import prior_moments
from poseppl.motion.points.linked_points import components
from poseppl.motion.points.named_points import PointRecording, make_point_problem, places_of
from poseppl.motion.points.settings import PointSettings
from poseppl.motion.points.smoothing import best_seen
from poseppl.program.parameters import parameter_bijector


@pytest.fixture(autouse=True)
def _double_precision() -> Iterator[None]:
    with double_precision():
        yield


def recording(num_frames: int = 4) -> PointRecording:
    """Two points in two cameras, of which the second is seen by one camera alone in the second frame."""
    cameras = join_cameras([look_at((3000.0, 0, 300), (0, 0, 0), 900.0), look_at((0.0, 3000, 0), (0, 0, 0), 900.0)])
    places = np.array([[10.0, 20, 30], [-40, 0, 90]]) + np.arange(num_frames)[:, None, None] * [1.0, 2, 0]
    points = np.moveaxis(np.asarray(project(cameras, jnp.asarray(places))), 0, 1).copy()
    points[1, 0, 1] = np.nan
    sure = np.where(np.isfinite(points[..., 0]), 0.9, 0.0)
    sizes, frames = np.full((2, 2), 1000.0), np.arange(num_frames)
    return PointRecording(("a", "b"), ("one", "two"), cameras, sizes, points, sure, frames, frames / 30.0, None, "")


@pytest.mark.full
def test_the_problem_starts_where_the_points_are() -> None:
    seen = recording()
    problem = make_point_problem(seen)
    places = problem.frame.to_world(np.moveaxis(np.asarray(places_of(problem.model, problem.start))[:, :, 0], 0, 1))
    assert np.allclose(places[2], [[12.0, 24, 30], [-38, 4, 90]], atol=1e-3)
    assert np.allclose(places[1, 1], [-39, 2, 90], atol=1e-3)  # between its neighbours
    mask = np.asarray(problem.observations.mask["points"])
    assert mask.sum() == mask.size - 2 and not mask[1, 1, 0].any()
    assert 0.29 < problem.frame.unit < 0.31  # a mm is 900 / 3000 px
    with pytest.raises(InputError, match="two cameras"):
        make_point_problem(seen._replace(points=np.where(np.arange(2)[:, None, None] == 1, np.nan, seen.points)))


@pytest.mark.full
def test_moments_of_the_prior_are_those_of_its_program() -> None:
    whole = make_point_problem(recording()).whole
    names = parameter_bijector(whole)
    mean, scale = prior_moments(whole, names)
    draws = jax.vmap(lambda key: names.to_flat(whole.sample_parameters(key)))(jax.random.split(jax.random.key(0), 2000))
    off = (np.asarray(draws).mean(0) - mean) / (scale / np.sqrt(2000))
    assert np.abs(off).max() < 4
    assert np.allclose(np.asarray(draws).std(0), scale, rtol=0.1)


def test_points_hang_together_by_links() -> None:
    links = [Link(ends, None, None, 0.1) for ends in ((0, 3), (1, 2), (3, 5))]
    assert components(6, links) == [(0, 3, 5), (1, 2)]
    assert components(3, []) == []


def test_the_frames_with_the_most_points() -> None:
    points = np.zeros((20, 1, 1, 2))
    points[[*range(4), 12]] = np.nan
    assert best_seen(points, 20, 2) is None
    found = best_seen(points, 10, 2)
    assert found is not None and found.tolist() == [4, 5, 6, 7, 8, 13, 14, 15, 16, 17]


def test_files_become_a_recording(data_dir: Path) -> None:
    board = data_dir / "charuco_board"
    records = read_cameras(board / "camera_array.toml")
    files = {record.name: board / "xy_CHARUCO.csv" for record in records[:3]}
    skeleton = Skeleton(("8", "0"), (), ())
    read = read_point_recording(PointSettings(files, records, skeleton=skeleton, frames="0:40:2", rate=30))
    assert read.points.shape == (20, 3, 2, 2) and read.rate == 15
    assert read.frames.tolist() == list(range(int(read.frames[0]), int(read.frames[0]) + 40, 2))
    first = read_point_recording(PointSettings(files, records, frames="0:1"))
    assert np.allclose(read.points[0, :, 1], first.points[0, :, 0], equal_nan=True)
    with pytest.raises(InputError, match="no point 'nose'"):
        read_point_recording(PointSettings(files, records, skeleton=Skeleton(("nose",), (), ())))
    with pytest.raises(InputError, match="no camera 'x'"):
        read_point_recording(PointSettings({"x": board / "xy_CHARUCO.csv"}, records))


def test_nothing_is_lost_of_files_that_have_faults(tmp_path: Path) -> None:
    """One ends early, one has a point at 1e9, one finds nothing in half of its frames: all is reported, the rest is kept."""
    header = "scorer,net,net,net\nbodyparts,a,a,a\ncoords,x,y,likelihood\n"
    rows = [f"{t},{100 + t},{200 + t},0.9\n" for t in range(10)]
    empty = [row if t < 5 else f"{t},,,\n" for t, row in enumerate(rows)]
    far = ["3,1e9,200,0.9\n" if t == 3 else row for t, row in enumerate(rows)]
    files = {}
    for name, lines in {"early": rows[:6], "far": far, "empty": empty}.items():
        files[name] = tmp_path / f"{name}.csv"
        files[name].write_text(header + "".join(lines), encoding="utf-8")
    camera = CameraRecord("", np.diag([500.0, 500.0, 1.0]), np.zeros(5), np.eye(3), np.zeros(3), (640, 480))
    read = read_point_recording(PointSettings(files, [camera._replace(name=name) for name in files]))
    seen = np.isfinite(read.points).all(-1)[..., 0]
    assert seen.sum(0).tolist() == [6, 9, 5]
    assert read.points[9, 1, 0].tolist() == [109.0, 209.0]
    told = "\n".join(read.notes)
    lacks, far_away, nothing = (
        "early: its file lacks 4 of 10 frames, from 6 to 9",
        "far: 1 points lie far",
        "empty: nothing was found",
    )
    for part in (lacks, far_away, nothing):
        assert part in told, told


def several(tmp_path: Path, **animals: list[str]) -> dict[str, Path]:
    """DeepLabCut's files by camera, of animals in this order; a point is at 10 for the first letter, 11 for the second, ..."""
    files = {}
    for camera, names in animals.items():
        rows = [["scorer"], ["individuals"], ["bodyparts"], ["coords"], *([str(t)] for t in range(3))]
        for name in names:
            x = 10 + ord(name) - ord("a")
            cells = zip(*[("net", name, "nose", kind, *[value] * 3) for kind, value in (("x", x), ("y", 20))], strict=True)
            for row, pair in zip(rows, cells, strict=True):
                row += map(str, pair)
        files[camera] = tmp_path / f"{camera}.csv"
        files[camera].write_text("\n".join(map(",".join, rows)) + "\n", encoding="utf-8")
    return files


def test_an_animal_goes_by_its_name_in_all_cameras(tmp_path: Path) -> None:
    camera = CameraRecord("", np.diag([500.0, 500.0, 1.0]), np.zeros(5), np.eye(3), np.zeros(3), (640, 480))
    records = [camera._replace(name=name) for name in ("one", "other")]
    files = several(tmp_path, one=["a", "b"], other=["b", "a"])
    for person, x in ((1, 10), (2, 11)):
        read = read_point_recording(PointSettings(files, records, person=person))
        assert set(read.points[..., 0].ravel().tolist()) == {x}
    with pytest.raises(InputError, match=r"other\.csv, person: no 'b'"):
        read_point_recording(PointSettings(several(tmp_path, one=["a", "b"], other=["a", "c"]), records, person=2))


@pytest.mark.full
def test_animals_without_names_are_refused(data_dir: Path) -> None:
    pose, records = (
        data_dir / "pose2sim_two_people",
        read_cameras(data_dir / "pose2sim_balancing/calibration/Calib_qualisys.toml"),
    )
    files = {f"cam_0{c}": next(pose.rglob(f"cam0{c}_json")) for c in (1, 2)}
    with pytest.raises(InputError, match="without names to identify them"):
        read_point_recording(PointSettings(files, records))


@pytest.mark.full
def test_one_file_for_two_cameras_is_refused(tmp_path: Path) -> None:
    camera = CameraRecord("", np.diag([500.0, 500.0, 1.0]), np.zeros(5), np.eye(3), np.zeros(3), (640, 480))
    files = dict.fromkeys(("one", "other"), several(tmp_path, one=["a"])["one"])
    with pytest.raises(InputError, match="one and other have the same points"):
        read_point_recording(PointSettings(files, [camera._replace(name=name) for name in files]))
