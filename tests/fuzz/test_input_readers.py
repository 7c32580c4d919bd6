"""Bad files of what people give: every reader says what is wrong, or takes them as they are."""

from collections.abc import Callable
from pathlib import Path

import pytest

from urbantwin.site import read_extract

from .harness import NUMBERS
from .reader import Reader

EXAMPLES = Path(__file__).parents[2] / "examples"


def _osm() -> list[bytes]:
    text = (EXAMPLES / "two-avenues" / "two-avenues.osm").read_bytes()
    return [text]


READERS = [
    Reader("osm", read_extract, "map.osm", _osm),
]


@pytest.mark.parametrize("mutations", NUMBERS)
@pytest.mark.parametrize("reader", READERS, ids=str)
def test_bad_files(reader: Reader, mutations: int, fuzz: Callable[[Reader, int], None]) -> None:
    fuzz(reader, mutations)
