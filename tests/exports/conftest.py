"""Twins to export: of the example its middle (right-hand traffic), and a real left-hand place."""

import pytest

from urbantwin.exports import export_twin
from urbantwin.exports.carla import write_carla
from urbantwin.site import load_site
from urbantwin.site.initial_site import init_site
from urbantwin.twin import build_twin, load_twin

from ..interface.conftest import line

__all__ = ["line"]


@pytest.fixture(scope="session", autouse=True)
def _planned_once(planned_once):
    """Plan a twin's traffic once for all exports."""


@pytest.fixture(scope="session")
def perth_twin(shared_data, made_once):
    def make(folder):
        site = init_site(folder, shared_data / "osm" / "perth_stretched_lights.osm")
        build_twin(load_site(site), folder / "twin")

    return load_twin(made_once("perth", make) / "twin")


@pytest.fixture(scope="session")
def small_twin(line):
    """The example within 40 m of its middle."""
    return line.twin


@pytest.fixture(scope="session")
def small_package(small_twin, made_once):
    """It as a package for CARLA."""
    made = made_once("small-carla", lambda folder: write_carla(small_twin, folder / "carla"))
    return made / "carla"


@pytest.fixture(scope="session")
def perth_package(perth_twin, made_once):
    """The real place as a package for CARLA."""

    def make(folder):
        assert not export_twin(perth_twin, "carla", folder / "carla").notes

    return made_once("perth-carla", make) / "carla"


@pytest.fixture(scope="session")
def carla_says(judge):
    """Ask CARLA's own classes, in the judges' Python (`make judges`)."""

    def ask(**job):
        return judge("carla_world", job=job)

    return ask
