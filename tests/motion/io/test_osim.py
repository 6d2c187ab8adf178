"""A model for OpenSim: its lengths, coordinates and markers, read back as XML."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from poseppl_models.bodies.choo_fleet import arm
from poseppl_models.bodies.footed import footed_body

from poseppl.errors import InputError
from poseppl.motion.bodies.opensim import opensim_coordinates
from poseppl.motion.tracking.opensim_model import opensim_markers, opensim_segments, write_model


def test_lengths_and_coordinates(tmp_path: Path) -> None:
    body = footed_body({"thigh": 444.0, "shank": 399.0})
    write_model(tmp_path / "p.osim", body, "p", body.tree.marker_names)
    model = ElementTree.parse(tmp_path / "p.osim").getroot()
    named = {each.get("name") for each in model.iter("Coordinate")}
    own = {each.name for each in opensim_coordinates(body) if not each.meaning.startswith("our own")}
    assert named == own
    place = {
        joint.get("name"): np.array(joint.find("frames/PhysicalOffsetFrame/translation").text.split(), float)  # type: ignore[union-attr]
        for joint in model.iter("CustomJoint")
    }
    np.testing.assert_allclose(place["tibia_r_joint"], [0, -0.444, 0], atol=1e-6)
    np.testing.assert_allclose(place["calcn_l_joint"], [0, -0.399, 0], atol=1e-6)
    head = {"skull", "crown", "nose", "eye_l", "eye_r", "ear_l", "ear_r"}
    assert {each.get("name") for each in model.iter("Marker")} == set(body.tree.marker_names) - head
    assert sum(float(each.text or 0) for each in model.iter("mass")) == pytest.approx(75.0, rel=0.01)


def test_markers_of_a_standing_person() -> None:
    """With all coordinates 0 the model's markers are where the body's are."""
    body = footed_body()
    at = {"ground": np.zeros(3)}
    for segment in opensim_segments(body):
        at[segment.name] = at[segment.parent] + segment.place
    ours = dict(zip(body.tree.marker_names, body.places(np.zeros((1, body.tree.dimension)))[0], strict=True))
    for marker in opensim_markers(body, body.tree.marker_names):
        forward_up_right = ours[marker.name][[1, 2, 0]] / 1000
        np.testing.assert_allclose(at[marker.segment] + marker.place, forward_up_right, atol=1e-5, err_msg=marker.name)


def test_a_body_without_a_pelvis(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no pelvis of OpenSim"):
        write_model(tmp_path / "p.osim", arm()._replace(segments={}), "p", ())
