"""Calibration: demand, drivers and signal timing of a site from recorded tracks."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.traffic.calibration.calibrate import calibrate_traffic
    from urbantwin.traffic.calibration.momentary import calibrate_observation

__all__ = ["calibrate_observation", "calibrate_traffic"]

names_on_demand(__name__)
