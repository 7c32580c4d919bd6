"""Placement: choice of sensors and their positions before installation."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.studies.placement.place import Placed, place
    from urbantwin.studies.placement.place_file import PlaceSpec, load_place_spec

__all__ = ["PlaceSpec", "Placed", "load_place_spec", "place"]

names_on_demand(__name__)
