"""Overlap of a body with the silhouettes it was tracked in, and the content of a result about the silhouettes themselves."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cv2", reason="needs pip install 'poseppl[vision]'")
from silhouette_rooms import RECORDS, SIZE, body, masks_of, pose

from poseppl.motion.silhouettes.overlap import overlap, silhouette_record
from poseppl.motion.silhouettes.scene import silhouette_scene

pytestmark = pytest.mark.full


def scene_of(states, hidden=None):
    drawn = [masks_of(state) for state in states]
    masks = {name: np.stack([each[name] for each in drawn]) for name in drawn[0]}
    for name, where in (hidden or {}).items():
        masks[name] = masks[name] * (where == 0)
    return silhouette_scene(body(), RECORDS, masks, occlusion=hidden)


def test_a_body_overlaps_with_its_own_silhouettes_and_less_the_farther_it_is():
    state = pose()
    away = np.stack([state, state, state])
    away[1, 0] += 60.0
    away[2, 0] += 200.0
    shares = overlap(scene_of([state] * 3), away)
    assert shares.shape == (3, 2)
    assert (shares[0] > 0.97).all() and (np.diff(shares, axis=0) < -0.05).all()
    # counted pixel by pixel, in the camera that looks along the shift and in the one that it crosses
    for camera, record in enumerate(RECORDS):
        seen, drawn = masks_of(state)[record.name] != 0, masks_of(away[2])[record.name] != 0
        assert shares[2, camera] == pytest.approx((seen & drawn).sum() / (seen | drawn).sum(), abs=0.06)


def test_what_is_hidden_does_not_count_and_who_is_not_seen_has_no_overlap():
    state = pose()
    occlusion = np.zeros(SIZE[::-1], np.uint8)
    occlusion[100:] = 1
    scene = scene_of([state, state], {"left": occlusion})
    scene = scene._replace(data=scene.data._replace(usable=np.array([[True, True], [True, False]])))
    shares = overlap(scene, np.stack([state, state]))
    assert (shares[0] > 0.95).all() and np.isnan(shares[1, 1])
    # a leg behind the furniture is not missed
    bent = state.copy()
    names = [".".join(each) for each in body().tree.coordinates]
    bent[[i for i, name in enumerate(names) if name.startswith("knee")]] += 0.8
    shares = overlap(scene, np.stack([bent, bent]))
    assert shares[0, 0] > 0.95 > 0.9 > shares[0, 1]
    # one that is seen before furniture is
    masks = {name: mask[None] for name, mask in masks_of(state).items()}
    before = silhouette_scene(body(), RECORDS, masks, occlusion={"left": occlusion})
    assert overlap(before, bent[None])[0, 0] < 0.95


def test_areas_and_centres_are_those_of_the_masks():
    states = [pose(), pose() + np.r_[0.0, 0.0, 150.0, np.zeros(25)]]
    record = silhouette_record(scene_of(states).data)
    for frame, state in enumerate(states):
        for camera, each in enumerate(RECORDS):
            rows, columns = np.nonzero(masks_of(state)[each.name])
            assert record["silhouette_area"][frame, camera] == pytest.approx(len(rows), rel=0.02)
            np.testing.assert_allclose(record["silhouette_centre"][frame, camera], [columns.mean(), rows.mean()], atol=0.5)


def test_empty_masks_have_neither():
    masks = {record.name: np.zeros((1, *SIZE[::-1]), np.uint8) for record in RECORDS}
    masks["left"][0] = masks_of(pose())["left"]
    with pytest.warns(match="camera right"):
        record = silhouette_record(silhouette_scene(body(), RECORDS, masks).data)
    assert np.isfinite(record["silhouette_area"][0]).tolist() == [True, False]
    assert np.isnan(record["silhouette_centre"][0, 1]).all()
