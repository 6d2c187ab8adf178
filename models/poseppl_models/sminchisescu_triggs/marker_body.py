"""The bodies of Sminchisescu and Triggs (2001) seen as points, with their joint limits and stabilisers, as NumPyro programs.

The limits are the supports of the sites (:mod:`poseppl_models.bodies.limited_walk`), so that these programs are for methods
that draw and evaluate densities, and for searches under bounds. Filters that want Gaussian transitions take
``limits="barrier"``: a plain walk, and a smooth log-factor at each frame instead.

>>> body = full_body()
>>> body.tree.dimension, len(body.tree.marker_names), body.program is full_body({"thigh": 400.0}).program
(34, 19, True)
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import numpyro
from jax import Array

from poseppl.motion.bodies.body import Body, BodyInputs
from poseppl.motion.geometry import marker_positions
from poseppl.motion.likelihoods import ProjectedMarkers
from poseppl.program import StateSpaceModel
from poseppl_models.bodies import choo_fleet
from poseppl_models.bodies.anthropometry import LENGTHS
from poseppl_models.bodies.choo_fleet import NOISE, WALK
from poseppl_models.bodies.joint_angles import smooth_limits
from poseppl_models.bodies.joint_names import ALIASES, edges_along, segments
from poseppl_models.bodies.limited_walk import limited_walk
from poseppl_models.bodies.random_walk import Observe, walking_body
from poseppl_models.sminchisescu_triggs.body import Kind, SuperquadricBody, superquadric_body

Limits = Literal["support", "barrier", "none"]


_ALIASES = {
    **ALIASES,
    **{
        f"toe_{s}": (f"{s}toes", f"{left}ToeBase", f"{left}Toe", f"{s.upper()}TOE")
        for s, left in (("l", "Left"), ("r", "Right"))
    },
}


_ARM, _LEG = choo_fleet.LIMBS


EDGES = edges_along(("pelvis", "chest", "neck", "skull", "crown"), (_ARM, (*_LEG, "toe")))


def full_body(lengths: Mapping[str, float] | None = None, *, limits: Limits = "support") -> Body:
    """Build the body of 34 coordinates, with clavicles.

    Args:
        lengths: Segment lengths in mm that differ from the standard humanoid's.
        limits: "support" limits the sites; "barrier" leaves them free and adds smooth log-factors.
    """
    return _body("full", lengths, limits)


def stiff_shoulders(lengths: Mapping[str, float] | None = None, *, limits: Limits = "support") -> Body:
    """Build the body of 30 coordinates, without clavicles; arguments as of :func:`full_body`."""
    return _body("stiff_shoulders", lengths, limits)


def arm(lengths: Mapping[str, float] | None = None, *, limits: Limits = "support") -> Body:
    """Build the arm of 8 coordinates, which hangs on an upright trunk; arguments as of :func:`full_body`."""
    return _body("arm", lengths, limits)


def _body(kind: Kind, known: Mapping[str, float] | None, limits: Limits) -> Body:
    body = superquadric_body(kind, known)
    program = _programs(kind, limits)
    sizes, turned = {name: body.sizes[name] for name in LENGTHS}, segments("thorax")
    whole = Body(program, body.tree, EDGES, "pelvis", _ALIASES, sizes, measure, None, body.rest, WALK, NOISE, segments=turned)
    if kind != "arm":
        return whole
    edges = (("shoulder_r", "elbow_r"), ("elbow_r", "wrist_r"), ("wrist_r", "thumb_r"))
    aliases = {name: ALIASES.get(name, (name,)) for name in body.tree.marker_names}
    return whole._replace(edges=edges, root="shoulder_r", aliases=aliases, measure=measure_arm, segments={})


@lru_cache(maxsize=8)
def _programs(kind: Kind, limits: Limits) -> StateSpaceModel:
    """Programs of a kind of body; all sizes share them."""
    body = superquadric_body(kind)

    def observe(params: Any, pose: Array, inputs: BodyInputs) -> None:
        numpyro.sample("points", ProjectedMarkers(inputs.tree, inputs.cameras, pose, inputs.noise))

    return limited_body(body, limits, observe)


def limited_body(body: SuperquadricBody, limits: Limits, observe: Observe) -> StateSpaceModel:
    """Write the programs of a body that walks within its limits and about its equilibrium, and is observed in a pose.

    Args:
        body: The body; its markers are kept as ``markers``.
        limits: "support" limits the sites; "barrier" leaves them free and adds a smooth log-factor; "none" does neither.
        observe: Observations of a pose.
    """
    bounds = body.limits if limits == "support" else np.tile([-np.inf, np.inf], (body.tree.dimension, 1))

    def limited(params: Any, pose: Array, inputs: Any) -> None:
        observe(params, pose, inputs)
        if limits == "barrier":
            numpyro.factor("limits", smooth_limits(body.limits, pose))
        numpyro.deterministic("markers", marker_positions(inputs.tree, pose))

    return walking_body(body.tree.coordinates, limited, lambda spans: limited_walk(spans, bounds, body.stabilisers))


def measure(markers: Mapping[str, Any]) -> dict[str, float]:
    """Measure a subject's segment lengths (mm) as :func:`poseppl_models.bodies.choo_fleet.measure` does.

    Trunk and shoulders keep the standard's split between waist and thorax, and between clavicle and shoulder.
    """
    found, standard = choo_fleet.measure(markers), superquadric_body("full").sizes
    trunk = found["spine"] / (standard["waist"] + standard["thorax"])
    across = found["shoulder_width"] / (standard["clavicle_side"] + standard["shoulder_side"])
    same = ("neck", "head", "upper_arm", "forearm", "thigh", "shank", "hip_forward", "hip_drop")
    return {name: found[name] for name in same} | {
        "waist": trunk * standard["waist"],
        "thorax": trunk * standard["thorax"],
        "clavicle_side": across * standard["clavicle_side"],
        "shoulder_side": across * standard["shoulder_side"],
        "clavicle_forward": found["shoulder_forward"],
        "clavicle_up": standard["shoulder_drop"] - found["shoulder_drop"],
        "hip_side": found["hip_width"],
    }


def measure_arm(markers: Mapping[str, Any]) -> dict[str, float]:
    """Measure upper arm and forearm (mm) as medians over frames.

    Raises:
        ValueError: Shoulder, elbow or wrist is never seen.
    """
    joints = [np.asarray(markers[name], float) for name in ("shoulder_r", "elbow_r", "wrist_r") if name in markers]
    apart = [np.linalg.norm(a - b, axis=-1) for a, b in zip(joints, joints[1:], strict=False)]
    if len(apart) < 2 or not all(np.isfinite(each).any() for each in apart):
        raise ValueError("no shoulder_r, elbow_r or wrist_r among the markers")
    upper_arm, forearm = (float(np.nanmedian(each)) for each in apart)
    return {"upper_arm": upper_arm, "forearm": forearm}
