"""Datasets and trees from variables and coordinates that are known to fit, without the checks of xarray's constructors.

xarray aligns the variables of each dataset, and each group of a tree with its parent. For a result of few numbers that takes
longer than the inference. Here the caller has checked the shapes, and all groups share the indexes of one set of coordinates.
Two shortcuts of xarray itself are used, which are not part of its documented interface. So the first call compares a small
tree with that of the public constructors, and if anything differs, or is missing, the public ones serve from then on.

>>> known = xr.Coordinates({"frame": np.arange(3)})
>>> group = dataset_of({"x": xr.Variable(("frame",), np.ones(3))}, known)
>>> tree_of({"posterior": group}, {"rate": 30.0})["posterior/x"].sum().item()
3.0
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr


def dataset_of(variables: Mapping[str, xr.Variable], known: xr.Coordinates) -> xr.Dataset:
    """A dataset of variables, with those of the coordinates whose dimensions they have.

    Args:
        variables: The variables by name; their shapes agree with the coordinates.
        known: Coordinates, each with an index along the dimension of its name.

    Raises:
        ValueError: A variable has the name of a coordinate, and not its dimension.
    """
    direct = _shortcuts_agree() and variables.keys().isdisjoint(known.variables)
    return _direct_dataset(variables, known) if direct else _public_dataset(variables, known)


def tree_of(groups: Mapping[str, xr.Dataset], attrs: Mapping[str, Any]) -> xr.DataTree:
    """A tree of groups, each on its own: the root has attributes, and no variables.

    Args:
        groups: The groups by name; the tree shares their arrays.
        attrs: Attributes of the root.
    """
    tree = _direct_tree(groups) if _shortcuts_agree() else _public_tree(groups)
    tree.attrs = dict(attrs)
    return tree


def _used(variables: Mapping[str, xr.Variable], known: xr.Coordinates) -> list[Any]:
    taken = {dim for variable in variables.values() for dim in variable.dims}
    return [dim for dim in known.variables if dim in taken]


def _public_dataset(variables: Mapping[str, xr.Variable], known: xr.Coordinates) -> xr.Dataset:
    used = _used(variables, known)
    coords = xr.Coordinates({dim: known.variables[dim] for dim in used}, {dim: known.xindexes[dim] for dim in used})
    return xr.Dataset(dict(variables), coords)


def _direct_dataset(variables: Mapping[str, xr.Variable], known: xr.Coordinates) -> xr.Dataset:
    indexes, labels = known.xindexes, known.variables
    used = _used(variables, known)
    coords = {dim: labels[dim].copy(deep=False) for dim in used}  # so that their attributes are those of this dataset
    sizes = {dim: size for each in variables.values() for dim, size in zip(each.dims, each.shape, strict=True)}
    return xr.Dataset._construct_direct({**variables, **coords}, set(used), sizes, indexes={dim: indexes[dim] for dim in used})


def _public_tree(groups: Mapping[str, xr.Dataset]) -> xr.DataTree:
    return xr.DataTree(children={name: xr.DataTree(group) for name, group in groups.items()})


def _direct_tree(groups: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """As the public one, whose checks compare the indexes of each group with those of a root that has none."""
    tree = _direct_node(None, {}, set(), {}, indexes={})
    for name, group in groups.items():
        own = {key: each.copy(deep=False) for key, each in group.variables.items()}
        contents = own, set(group.coords), dict(group.sizes), dict(group.attrs) or None
        node = _direct_node(name, *contents, dict(group.xindexes), dict(group.encoding))
        tree._children[name], node._parent = node, tree
    return tree


def _direct_node(name: str | None, *contents: Any, **more: Any) -> xr.DataTree:
    """A tree of one node with the contents of a dataset."""
    node = object.__new__(xr.DataTree)
    node._set_node_data(xr.Dataset._construct_direct(*contents, **more))
    super(xr.DataTree, node).__init__(name)
    return node


@functools.cache
def _shortcuts_agree() -> bool:
    """Whether the installed xarray has the shortcuts, and they make what its public constructors make."""
    try:
        known = xr.Coordinates({"frame": np.arange(3), "draw": np.arange(2), "name": np.array(["a"])})
        variables = {"x": xr.Variable(("draw", "frame"), np.ones((2, 3))), "y": xr.Variable(("other",), np.ones(4))}
        made = [build(variables, known) for build in (_direct_dataset, _public_dataset)]
        trees = [
            build({"first": group, "second": group}) for build, group in zip((_direct_tree, _public_tree), made, strict=True)
        ]
        contents = [(list(each.variables), dict(each.sizes), set(each.coords), set(each.xindexes)) for each in made]
        nodes = [[(node.path, node.name, node.parent is tree) for node in tree.subtree] for tree in trees]
        same = made[0].identical(made[1]) and trees[0].identical(trees[1])
    except Exception:  # of whatever changed in xarray
        return False
    return same and contents[0] == contents[1] and nodes[0] == nodes[1]
