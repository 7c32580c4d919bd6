"""The stand of the reliability tests: a small site, and what every command makes of it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from .small_site import Stand, make_line


@pytest.fixture(scope="session")
def stand(
    request: pytest.FixtureRequest,
    made_once: Callable[[str, Callable[[Path], object]], Path],
    tmp_path_factory: pytest.TempPathFactory,
) -> Stand:
    all_moments = any(one.get_closest_marker("kills") for one in request.session.items)
    made = Stand(tmp_path_factory.mktemp("stand"), closed_loop=all_moments)
    if not all_moments:
        made.take(made_once("small-line", make_line))
    return made
