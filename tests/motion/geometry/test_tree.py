from __future__ import annotations

from itertools import permutations, product

import jax.numpy as jnp
import numpy as np
import pytest
from bodies import JOINTS, MARKERS, mixed_tree, plain_kinematics, states
from precision import epsilon

from poseppl.motion.geometry import Joint, Marker, kinematic_tree, marker_positions

ROOT = Joint("a", None, (0, 0, 0))
AXES = ["".join(order) for order in permutations("XYZ")] + ["".join(two) for two in product("XYZ", repeat=2)]
AXES += ["", "X", "Y", "Z", "XYX", "ZXZXZ"]


@pytest.mark.parametrize(
    ("joints", "markers", "message"),
    [
        ([], [Marker("m", "a")], "first joint must be the root"),
        ([Joint("a", "b", (0, 0, 0))], [Marker("m", "a")], "first joint must be the root"),
        ([Joint("a", None, (0, 0, 1))], [Marker("m", "a")], "offset"),
        ([ROOT], [], "at least one marker"),
        ([ROOT, Joint("a", "a", (0, 0, 1))], [Marker("m", "a")], "two joints are named 'a'"),
        ([ROOT, Joint("b", "c", (0, 0, 1))], [Marker("m", "a")], "names parent 'c'"),
        ([ROOT, Joint("b", None, (0, 0, 1))], [Marker("m", "a")], "names parent None"),
        ([ROOT, Joint("b", "a", (0, 0, 1), "ZW")], [Marker("m", "a")], "axes 'ZW'"),
        ([ROOT, Joint("b", "a", (0, 0, 1), "zyx")], [Marker("m", "a")], "axes 'zyx'"),
        ([ROOT], [Marker("m", "b")], "rides on joint 'b'"),
        ([ROOT], [Marker("m", "a"), Marker("m", "a")], "two markers are named 'm'"),
    ],
)
def test_refuses(joints, markers, message):
    with pytest.raises(ValueError, match=message):
        kinematic_tree(joints, markers)


@pytest.mark.full
@pytest.mark.parametrize("axes", AXES)
def test_axes_in_any_order(axes):
    """Joints are split into links of rotations about Z, Y, X; the products stay as declared."""
    joints = [ROOT, Joint("b", "a", (30, 0, 100), axes), Joint("c", "b", (0, 20, -250), axes[::-1])]
    markers = [Marker("m", "c", (5, 6, 70)), Marker("n", "b", (1, 2, 3))]
    tree = kinematic_tree(joints, markers)
    assert tree.dimension == 6 + 2 * len(axes)
    for state in states(tree, 3):
        found = marker_positions(tree, jnp.asarray(state, jnp.float32))
        np.testing.assert_allclose(found, plain_kinematics(joints, markers, state), atol=1000 * 20 * epsilon(np.float32))


def test_layout():
    tree = mixed_tree()
    assert tree.coordinate_names[:6] == ("root.tx", "root.ty", "root.tz", "root.Z", "root.Y", "root.X")
    assert tree.dimension == 3 + sum(len(joint.axes) for joint in JOINTS)
    assert tree.joint_names == tuple(joint.name for joint in JOINTS)
    assert tree.marker_names == tuple(marker.name for marker in MARKERS)
    assert list(tree.depths) == sorted(tree.depths)
    assert all(parent < link for link, parent in enumerate(tree.parents))
    for link, parent in enumerate(tree.parents):
        path = {link} if parent < 0 else {link} | set(np.flatnonzero(tree.ancestors[parent]))
        assert set(np.flatnonzero(tree.ancestors[link])) == path
    used = sorted(index for row in tree.angle_index for index in row if index >= 0)
    assert used == list(range(3, tree.dimension))


@pytest.mark.full
def test_root_alone():
    tree = kinematic_tree([Joint("a", None, (0, 0, 0), "")], [Marker("m", "a", (1, 2, 3))])
    np.testing.assert_array_equal(marker_positions(tree, jnp.array([10.0, 20.0, 30.0])), [[11, 22, 33]])
