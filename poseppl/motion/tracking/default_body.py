"""The body that is tracked where nobody names one."""

from poseppl_models.bodies.choo_fleet import full_body

from poseppl.motion.bodies.body import name_of_builder

DEFAULT_MODEL = name_of_builder(full_body)
