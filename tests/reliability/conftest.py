"""The stand of the reliability tests: a small site, and what every command makes of it."""

import pytest

from .small_site import Stand


@pytest.fixture(scope="session")
def stand(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Stand:
    all_moments = any(one.get_closest_marker("kills") for one in request.session.items)
    return Stand(tmp_path_factory.mktemp("stand"), closed_loop=all_moments)
