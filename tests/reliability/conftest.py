"""The stand of the reliability tests: a small site, and what every command makes of it."""

import signal

import pytest

from .small_site import Stand


@pytest.fixture(scope="session", autouse=True)
def heard() -> None:
    """Let programs hear signals that a shell in the background has them ignore."""
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_IGN:  # exec turns any handler into the default
            signal.signal(number, signal.default_int_handler)


@pytest.fixture(scope="session")
def stand(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Stand:
    all_moments = any(one.get_closest_marker("kills") for one in request.session.items)
    return Stand(tmp_path_factory.mktemp("stand"), closed_loop=all_moments)
