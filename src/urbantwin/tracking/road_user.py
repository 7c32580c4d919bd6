"""Motion models of road users, and measurement errors of detectors, for the filters.

The values are round numbers for pedestrians, riders and drivers in towns (everyday accelerations
stay below 3 m/s2, hard braking below 6), and for errors of LiDAR detectors. They are not fitted to
any recording.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["GROUPS", "RoadUser", "group_of"]


@dataclass(frozen=True)
class RoadUser:
    """A group of road users with the same motion model; detections never change between groups.

    Attributes:
        name: name of the group.
        classes: classes of actors (``taxonomy.ACTOR_CLASSES``).
        turns: whether it moves only along its heading, as wheels do; pedestrians step to any side.
        place_m: standard deviation of a detected centre in plan, metres.
        height_m: standard deviation of a detected underside, metres.
        yaw: standard deviation of a detected axis, radians.
        accelerates: noise density of the speed, (m/s)2 per second.
        swerves: noise density of the yaw rate, (rad/s)2 per second; for pedestrians of the heading
            itself, rad2 per second.
        slips_m: random walk of the centre across the heading, metres per root second: a vehicle's
            centre is ahead of its rear axle, which alone follows the heading.
        speed_m_s: standard deviation of an unknown speed, m/s.
        fastest_m_s: maximum speed, m/s.
    """

    name: str
    classes: tuple[str, ...]
    turns: bool
    place_m: float
    height_m: float
    yaw: float
    accelerates: float
    swerves: float
    slips_m: float
    speed_m_s: float
    fastest_m_s: float


GROUPS: tuple[RoadUser, ...] = (
    RoadUser(
        *("people", ("pedestrian", "animal"), False),
        *(0.15, 0.15, 0.7),
        *(0.5, 0.5, 0.0, 1.3, 6.0),
    ),
    RoadUser(
        *("riders", ("bicycle", "motorcycle"), True),
        *(0.2, 0.15, 0.3),
        *(1.5, 0.4, 0.15, 5.0, 30.0),
    ),
    RoadUser(
        *("vehicles", ("car", "van", "truck", "trailer", "bus"), True),
        *(0.3, 0.2, 0.2),
        *(4.0, 0.15, 0.15, 8.0, 50.0),
    ),
    RoadUser(
        *("trams", ("tram",), True),
        *(0.4, 0.2, 0.1),
        *(1.5, 0.02, 0.15, 6.0, 25.0),
    ),
)

_GROUP_OF = {name: group for group in GROUPS for name in group.classes}


def group_of(actor_class: str) -> RoadUser:
    """Return the motion model of a class; that of vehicles for unknown classes."""
    return _GROUP_OF.get(actor_class, GROUPS[2])
