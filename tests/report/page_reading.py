"""Data of a page's script as Python values: the inverse of :func:`poseppl.report.page.to_json`."""

from __future__ import annotations

import base64
import json
import re
from typing import Any

import numpy as np


def decoded(text: str) -> Any:
    """The value, arrays as nested lists with None where nothing is known."""
    read = json.loads(text)
    arrays = [_array(each) for each in read["arrays"]]

    def filled(value: Any) -> Any:
        if isinstance(value, dict):
            return arrays[value["array"]] if value.keys() == {"array"} else {key: filled(each) for key, each in value.items()}
        return [filled(each) for each in value] if isinstance(value, list) else value

    return filled(read["value"])


def data_of(page: str, name: str) -> Any:
    """The data of a page by the id of their element."""
    found = re.search(f'<script type="application/json" id="{name}">(.*?)</script>', page, re.S)
    assert found
    return decoded(found.group(1))


def _array(given: dict[str, Any]) -> Any:
    codes = np.frombuffer(base64.b64decode(given["codes"]), "<u2").reshape(given["shape"])
    values = given["low"] + codes * given["step"]
    return np.where(codes == 65_535, None, values.astype(object)).tolist()
