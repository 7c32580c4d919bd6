"""Twins to export: beside the example (right-hand traffic), a real place with left-hand traffic."""

import os
from pathlib import Path

import pytest

from urbantwin.exports.carla import write_carla
from urbantwin.site import load_site
from urbantwin.site.initial_site import init_site
from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.twin import build_twin, load_twin

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session", autouse=True)
def planned_once():
    """Plan a twin's traffic once for all exports: in a closed loop that takes pilot simulations."""
    known = {}

    def planned(twin, *, duration_s, seed, scratch=None):
        key = twin.sha256, duration_s, seed
        if key not in known:
            known[key] = demand_of(twin, duration_s=duration_s, seed=seed, scratch=scratch)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        for module in ("sumo", "carla.traffic"):
            patch.setattr(f"urbantwin.exports.{module}.demand_of", planned)
        yield planned


@pytest.fixture(scope="session")
def perth_twin(shared_data, made_once):
    def make(folder):
        site = init_site(folder, shared_data / "osm" / "perth_stretched_lights.osm")
        build_twin(load_site(site), folder / "twin")

    return load_twin(made_once("perth", make) / "twin")


@pytest.fixture(scope="session")
def two_avenues_package(two_avenues_twin, made_once):
    """The example as a package for CARLA."""
    return (
        made_once(
            "two-avenues-carla", lambda folder: write_carla(two_avenues_twin, folder / "carla")
        )
        / "carla"
    )


@pytest.fixture(scope="session")
def carla_python():
    """A Python that has CARLA: the judges' (`make judges`)."""
    python = Path(os.environ.get("URBANTWIN_JUDGES", ROOT / ".venv-judges" / "bin" / "python"))
    if not python.exists():
        pytest.skip("CARLA's own map is not installed (make judges)")
    return str(python)


@pytest.fixture(scope="session")
def carla_says(judge):
    """Ask CARLA's own classes, in the judges' Python (`make judges`)."""

    def ask(**job):
        return judge("carla_world", job=job)

    return ask
