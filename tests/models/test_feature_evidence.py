"""Evidence of a drawn frame: what its features say reaches the likelihoods."""

import jax.numpy as jnp
import numpy as np
import pytest
from image_scenes import HEIGHT, STRIDE, WIDTH, cameras, masks, true_pose
from poseppl_models.du_guan.likelihood import du_guan_body
from poseppl_models.images.evidence import colours_at, du_guan_of_features, two_way_of_features
from poseppl_models.images.silhouette_bits import unpack_bits

from poseppl.motion.vision import BackgroundSettings, FeatureSettings, background_from_plate, extract

pytestmark = pytest.mark.full

pytest.importorskip("cv2", reason="needs pip install 'poseppl[vision]'")


@pytest.fixture(scope="module")
def drawn():
    """A red person before a gray wall in two cameras; what is right of column 120 is hidden."""
    body, view = du_guan_body(), cameras(2)
    plate, hidden = np.full((HEIGHT, WIDTH, 3), 120, np.uint8), np.zeros((HEIGHT, WIDTH), np.uint8)
    hidden[:, 120:] = 1
    shown = masks(body, true_pose(body), view)
    images = [np.where(mask[..., None], np.array([220, 20, 20], np.uint8), plate) for mask in shown]
    settings = FeatureSettings(background=BackgroundSettings(opening=0, closing=0, min_area=0, largest_hole=0), flow=None)
    background = background_from_plate(plate, settings.background)
    return body, view, shown, images, [extract(image, background, settings, ignore=hidden) for image in images]


def test_silhouettes_and_edges(drawn):
    _, _, shown, _, features = drawn
    found = two_way_of_features(features, stride=STRIDE)
    grid = np.s_[:, STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE]
    foreground, known = (unpack_bits(np.asarray(words), WIDTH // STRIDE) for words in (found.foreground, found.known))
    np.testing.assert_array_equal(known, np.broadcast_to(np.arange(WIDTH) < 120, shown.shape)[grid])
    np.testing.assert_array_equal(foreground, (shown & (np.arange(WIDTH) < 120))[grid])
    errors = np.asarray(found.edge_error)[:, :HEIGHT]
    assert np.all(errors[:, :, 120:] == -1) and np.all(errors[:, :, :120] >= 0)
    near = np.stack([each.edge_proximity for each in features])[:, :, :120]
    np.testing.assert_allclose(errors[:, :, :120], (1 - near) ** 2, atol=1e-6)


def test_colours_of_the_known_pose_are_found_again(drawn):
    body, view, _, images, features = drawn
    colours = colours_at(body, true_pose(body), view, features, images)
    seen = colours.sum(-1) > 0
    assert seen.any() and np.all((colours.argmax(-1) == colours[seen][0].argmax())[seen])
    found = du_guan_of_features(features, images, colours, stride=STRIDE)
    assert found.bins.shape == (2, HEIGHT + 1, WIDTH) and bool(jnp.all(found.part_weights == 1))
    assert bool(jnp.all(found.bins[:, :, 120:] == -1)) and bool(jnp.all(jnp.isfinite(found.descriptors)))
