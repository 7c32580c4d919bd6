"""The stand of the reliability tests: a small site, and what every command makes of it."""

import pytest

from .small_site import Stand


@pytest.fixture(scope="session")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Stand:
    return Stand(tmp_path_factory.mktemp("stand"))
