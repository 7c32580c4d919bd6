"""Reading heights of a road: elevation, superelevation, crossfall, shape."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from lxml import etree

from urbantwin.roads.model import Profile
from urbantwin.roads.opendrive.cubics import added, stepped
from urbantwin.roads.opendrive.reading.parsing import Spot

__all__ = ["read_heights"]

#: A cross section may differ this much from a crown before it is remarked, metres.
SHAPE_M = 0.01


def read_heights(
    road: etree._Element, length: float, reach: tuple[float, float], spot: Spot
) -> tuple[Profile, Profile, Profile]:
    """Return elevation, superelevation and crown of a road.

    A crossfall (1.1 to 1.4) or a shape (1.4 on) becomes a crown, symmetric about the reference
    line, and what is one-sided about it adds to the superelevation. What a cross section has beyond
    that (a gutter, a crown beside the reference line) is left out and remarked.

    Args:
        road: the ``<road>``.
        length: length of its reference line.
        reach: how far lanes reach to the left and to the right of the reference line, metres.
        spot: the road, for errors.
    """
    elevation = spot.profile(road.findall("elevationProfile/elevation"))
    bank = spot.profile(road.findall("lateralProfile/superelevation"))
    crown = Profile.constant(0.0)
    if np.abs(bank.at(np.linspace(0, length, 9))).max() > 1.0:
        spot.drop("has a superelevation of more than 1 radian")
        bank = Profile.constant(0.0)
    crossfall = road.findall("lateralProfile/crossfall")
    if crossfall:
        left, right = (
            spot.profile([e for e in crossfall if e.get("side", "both") in (side, "both")])
            for side in ("left", "right")
        )
        crown = added([(0.5, left), (0.5, right)], length)
        bank = added([(1.0, bank), (0.5, right), (-0.5, left)], length)
    shapes = road.findall("lateralProfile/shape")
    if shapes:
        lift, tilt, shape = _shape(shapes, reach, spot)
        elevation = added([(1.0, elevation), (1.0, lift)], length)
        bank = added([(1.0, bank), (1.0, tilt)], length)
        crown = added([(1.0, crown), (1.0, shape)], length)
    if road.find("lateralProfile/crossSectionSurface") is not None:
        spot.remark("cross section surfaces that are not read: such roads are flat across")
    return elevation, bank, crown


def _shape(
    shapes: Sequence[etree._Element], reach: tuple[float, float], spot: Spot
) -> tuple[Profile, Profile, Profile]:
    """Return height at the reference line, tilt to the left, and crown of cross sections."""
    by_station: dict[float, list[etree._Element]] = {}
    for item in shapes:
        by_station.setdefault(spot.number(item, "s"), []).append(item)
    stations = sorted(by_station)
    across = np.concatenate(
        [np.linspace(-max(reach[1], 0.5), 0, 8), np.linspace(0, max(reach[0], 0.5), 8)[1:]]
    )
    rows = []
    for s in stations:
        # Before its first record a section goes on as that one does.
        height = spot.profile(by_station[s], "t").at(across)
        middle = height[7]
        # Least squares over both sides: z = lift + tilt t - crown |t|.
        basis = np.column_stack([across, -np.abs(across)])
        tilt, crown = np.linalg.lstsq(basis, height - middle, rcond=None)[0]
        if np.abs(basis @ [tilt, crown] - (height - middle)).max() > SHAPE_M:
            spot.remark("cross sections more than 1 cm off a crown: the nearest crown is taken")
        rows.append((middle, tilt, crown))
    lift, tilt, crown = zip(*rows, strict=True)
    return stepped(stations, lift), stepped(stations, tilt), stepped(stations, crown)
