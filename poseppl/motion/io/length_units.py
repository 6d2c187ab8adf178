"""Units of length in files."""

from __future__ import annotations

from poseppl.errors import Argument, Location, Phrase, brief

MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "in": 25.4}
UNKNOWN_UNIT = Phrase("the calibration does not state its unit; metres are assumed (", Argument("unit"), " sets it)")


def mm_per_unit(unit: object, at: Location) -> float:
    """How many mm a unit has.

    Raises:
        InputError: It is none of the names in :data:`MM_PER_UNIT`.
    """
    if not isinstance(unit, str) or unit not in MM_PER_UNIT:
        raise at.error(f"unit {brief(unit)}", " or ".join(f'"{known}"' for known in MM_PER_UNIT))
    return MM_PER_UNIT[unit]
