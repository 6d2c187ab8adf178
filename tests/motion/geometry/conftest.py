from __future__ import annotations

import pytest
from precision import DTYPES, precision


@pytest.fixture(params=DTYPES, ids=lambda dtype: dtype.__name__)
def dtype(request):
    """Run the test in single and in double precision."""
    with precision(request.param):
        yield request.param
