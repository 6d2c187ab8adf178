"""Generative models as NumPyro programs: bodies, observation processes and toys with known answers."""

BODIES = (
    "poseppl_models.bodies.choo_fleet:full_body",
    "poseppl_models.bodies.choo_fleet:lower_body",
    "poseppl_models.bodies.choo_fleet:arm",
    "poseppl_models.bodies.footed:footed_body",
    "poseppl_models.darby.marker_body:full_body",
    "poseppl_models.peursum.marker_body:full_body",
    "poseppl_models.bodies.silhouettes:full_body",
    "poseppl_models.sminchisescu_triggs.marker_body:full_body",
    "poseppl_models.sminchisescu_triggs.marker_body:stiff_shoulders",
    "poseppl_models.sminchisescu_triggs.marker_body:arm",
)
"""The builders of bodies that can be tracked; results may name them."""
