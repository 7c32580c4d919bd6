"""Heights of roads fitted to the smoothed ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from urbantwin.ground import Elevation
from urbantwin.roads.levels import Lift
from urbantwin.roads.model import LaneModel, ModelRoad, Profile, fitted

__all__ = ["with_heights"]

#: Largest difference between the profiles and the ground that they are fitted to, metres.
TOLERANCE_M = 0.004


def with_heights(model: LaneModel, elevation: Elevation, lift: Lift) -> LaneModel:
    """Return the model with elevation and superelevation of every road."""
    if elevation.is_flat and not lift.height.any():
        return model
    streets = {r.id: _street(r, elevation, lift) for r in model.roads if r.junction < 0}
    roads = [
        streets.get(road.id) or _connecting(road, streets, elevation, lift) for road in model.roads
    ]
    return model.with_roads(tuple(roads))


def _street(road: ModelRoad, elevation: Elevation, lift: Lift) -> ModelRoad:
    s = np.linspace(0.0, road.length, max(2, int(np.ceil(road.length)) + 1))
    section = road.sections[0]
    t = np.array([float(road.middle(section, lane, 0.0)[0]) for lane in section.lanes])
    xy = np.vstack([road.curve.beside(s, np.full(len(s), offset)) for offset in t])
    z = (elevation.smooth_at(xy) + lift.at(xy, road.level)).reshape(len(t), len(s))
    spread = t[:, None] - t.mean()
    slope = (spread * (z - z.mean(axis=0))).sum(axis=0) / max(float((spread**2).sum()), 1e-9)
    bank = fitted(s, np.arctan(slope), tolerance=TOLERANCE_M / max(1.0, float(np.abs(t).max())))
    level = z.mean(axis=0) - t.mean() * np.sin(bank.at(s))
    return replace(road, elevation=fitted(s, level, tolerance=TOLERANCE_M), bank=bank)


def _connecting(
    road: ModelRoad, streets: dict[int, ModelRoad], elevation: Elevation, lift: Lift
) -> ModelRoad:
    s = np.linspace(0.0, road.length, max(2, int(np.ceil(road.length)) + 1))
    xy = road.curve.at(s)[:, :2]
    z = elevation.smooth_at(xy) + lift.at(xy, road.level)
    slopes, banks = [], []
    for end, link in ((0, road.predecessor), (-1, road.successor)):
        assert link is not None
        other = streets[link.id]
        at = other.length if link.contact == "end" else 0.0
        sign = 1.0 if (link.contact == "end") == (end == 0) else -1.0
        t = float(other.curve.locate(xy[[end]])[1][0])
        angle = float(other.bank.at(at)[0])
        z[end] = other.heights(at, t)[0]
        slopes.append(sign * float((other.elevation.slope(at) + t * other.bank.slope(at))[0]))
        banks.append(sign * angle)
    bank = Profile.ramp(banks[0], banks[1], road.length)
    rise = fitted(s, z, tolerance=TOLERANCE_M, slopes=(slopes[0], slopes[1]))
    return replace(road, elevation=rise, bank=bank)
