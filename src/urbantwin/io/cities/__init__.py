"""City models: CityJSON and CityGML."""

from __future__ import annotations

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.io.cities.citygml import read_citygml
    from urbantwin.io.cities.cityjson import read_cityjson

__all__ = ["read_citygml", "read_cityjson"]

names_on_demand(__name__)
