"""Sets of parameters of which scripts/test takes the first, and scripts/test --all the others as well."""

from collections.abc import Iterable
from typing import Any

import pytest


def first_of(values: Iterable[Any], count: int = 1) -> list[Any]:
    """The values for `pytest.mark.parametrize`, all but the first `count` marked as slow.

    To build the kernel of one geometry, interpolant and precision takes one to five seconds.
    """
    every = [value if isinstance(value, tuple) else (value,) for value in values]
    return [pytest.param(*value, marks=[pytest.mark.slow] * (at >= count)) for at, value in enumerate(every)]
