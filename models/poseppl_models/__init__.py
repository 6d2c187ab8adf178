"""Generative models as NumPyro programs: bodies, observation processes and toys with known answers."""

BODIES = (
    "poseppl_models.choo_fleet:full_body",
    "poseppl_models.choo_fleet:lower_body",
    "poseppl_models.choo_fleet:arm",
    "poseppl_models.darby:full_body",
    "poseppl_models.peursum:full_body",
    "poseppl_models.silhouettes:full_body",
    "poseppl_models.sminchisescu:full_body",
    "poseppl_models.sminchisescu:stiff_shoulders",
    "poseppl_models.sminchisescu:arm",
)
"""The builders of bodies that can be tracked; results may name them."""
