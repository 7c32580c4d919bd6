"""What `make thorough` tries besides what `make test` does."""

from typing import Any

import pytest


def further(*values: Any) -> list[Any]:
    """Return values of a parametrization for `make thorough` alone; a tuple is a set of values."""
    return [
        pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=pytest.mark.thorough)
        for one in values
    ]
