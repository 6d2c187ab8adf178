"""Attributes of XML elements as numbers: what the readers of calibrations in XML share."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from poseppl.arrays import Floats
from poseppl.errors import Location
from poseppl.motion.io.camera_fields import numbers
from poseppl.motion.io.text_parsing import parse_number


class NumberAttributes:
    """Numbers of the attributes of an element.

    Args:
        element: The element; None where it is missing.
        at: Position.

    Raises:
        InputError: The element is missing.
    """

    def __init__(self, element: ElementTree.Element | None, at: Location) -> None:
        self.at = at
        if element is None:
            raise at.error("it is missing")
        self._element = element

    def __call__(self, *names: str) -> Floats:
        """One number of each attribute."""
        return numbers(self.at, [self._parsed(name, self._text(name)) for name in names], 1)

    def list(self, name: str, count: int) -> Floats:
        """So many numbers of one attribute, that spaces separate."""
        words = self._text(name).split()
        if len(words) != count:
            raise self._field(name).error(f"{len(words)} values", f"{count} numbers")
        return numbers(self.at, [self._parsed(name, word) for word in words], 1)

    def _text(self, name: str) -> str:
        text = self._element.get(name)
        if text is None:
            raise self._field(name).error("it is missing")
        return text

    def _parsed(self, name: str, text: str) -> float:
        return parse_number(text.strip(), self._field(name))

    def _field(self, name: str) -> Location:
        return self.at.in_field(f"{self.at.field}.{name}")
