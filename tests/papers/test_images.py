"""Published systems on a rendered scene, small; and what their samplers and models are held against."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from poseppl_papers.catalogue import find_experiment
from poseppl_papers.du_guan.mueller import BASINS, EXACT, SURFACE, basin_shares, true_shares
from poseppl_papers.images.scenes import Scene, see
from poseppl_papers.images.systems import LIMBS, Method, System, problem_of
from poseppl_papers.images.tracking import Blind, Tracking, blind, track
from poseppl_papers.recordings import BUILT_IN
from poseppl_papers.reproduction import reproduce
from poseppl_papers.tables import read_folder

from poseppl.jobs import Processes
from poseppl.motion.rendering.render import load_mujoco

DOCS = Path(__file__).resolve().parents[2] / "docs"
SCENE = Scene(BUILT_IN, clutter=False, num_frames=5, width=320, height=240)
BUILDERS = "poseppl_models.images.image_systems"


def test_shares_of_basins_are_those_of_quadrature():
    rows = read_folder(DOCS / "du-guan-2006")["mueller"].table.records(method=EXACT, temperature=15)
    found = 100 * true_shares(SURFACE, 15.0)
    np.testing.assert_allclose(found, [rows[0][name] for name in BASINS], atol=0.05)
    assert true_shares(SURFACE, 50.0)[0] < found[0] / 100 - 0.1
    positions = np.array([(-0.56, 1.44), (0.62, 0.03), (0.5, 0.1), (-0.05, 0.47)])
    np.testing.assert_allclose(basin_shares(SURFACE, positions), [0.25, 0.5, 0.25])


@pytest.fixture
def rendered(tmp_path_factory, monkeypatch):
    """A cache of its own, which is empty at first."""
    load_mujoco()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    see.cache_clear()
    problem_of.cache_clear()
    yield
    see.cache_clear()
    problem_of.cache_clear()


@pytest.mark.slow
def test_systems_track_a_rendered_walk(rendered):
    annealed = Method("APF", "annealed", (("crossover", LIMBS), ("num_layers", 5), ("num_particles", 200)))
    demc = Method("DE-MC", "demc", (("num_layers", 5), ("num_particles", 200)))
    systems = {
        System("peursum", f"{BUILDERS}:peursum_system", 4, (("measured", True),)): annealed,
        System("darby, Eq. 8", f"{BUILDERS}:darby_system", 4): annealed,
        System("darby, Eq. 9", f"{BUILDERS}:darby_system", 1, (("equation", 9),)): annealed,
        System("du-guan", f"{BUILDERS}:du_guan_system", 1): demc,
    }
    for system, method in systems.items():
        held, closest = blind(Blind(SCENE, system, 5))["errors"][:, 1:].mean(1)
        assert closest[0] < 20 < held[0]
        found = track(Tracking(SCENE, system, 5, method, (0, 1), weighs=system.name == "du-guan"))
        assert found["errors"].shape == (2, 5, 4) and not found["failed"].any()
        if system.views == 4:
            assert (found["errors"][:, 1:, 0].mean(1) < held[0] / 2).all()  # one that sees nothing would not follow
        assert np.isfinite(found["weight"]).all() == (system.name == "du-guan")
        assert (found["evaluations"] == (1200 if system.name == "du-guan" else 1000)).all()
        again = track(Tracking(SCENE, system, 5, method, (1,)))
        np.testing.assert_array_equal(again["errors"][0], found["errors"][1])


@pytest.mark.slow
def test_an_experiment_in_images_from_scenes_to_its_page(rendered, tmp_path):
    """In processes of its own, which render and write the truth; a second call computes nothing."""
    experiment = find_experiment("darby-2008")
    tiny = experiment.quick._replace(num_frames=3, scene_frames=3, size=(160, 120), particles=(10,), runs=2)
    part = ["one-camera"]
    tables = reproduce(experiment, tmp_path, parts=part, scale=tiny, executor=Processes(1))
    page = (tmp_path / "page.md").read_text()
    assert "## Claims" in page and "Eq. 9, one camera" in page
    assert {row["system"] for row in tables["one_camera"].records()} == {"darby, Eq. 8", "darby, Eq. 9"}
    assert (tmp_path / "one_camera.png").stat().st_size > 10_000
    written = {path: path.stat().st_mtime_ns for path in (tmp_path / "jobs").iterdir()}
    again = reproduce(experiment, tmp_path, parts=part, scale=tiny, executor="inline")
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "jobs").iterdir()} == written
    assert again["one_camera"].rows[-1][:10] == tables["one_camera"].rows[-1][:10]
