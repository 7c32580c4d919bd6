"""Catalogues of sensors and of actors."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.interface.actor_catalogue import ActorCatalogue, actors
    from urbantwin.interface.sensor_catalogue import Datasheet, SensorCatalogue, sensors

__all__ = [
    "ActorCatalogue",
    "Datasheet",
    "SensorCatalogue",
    "actors",
    "sensors",
]

names_on_demand(__name__)
