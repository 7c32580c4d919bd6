"""How road users move, and how well detectors place them: what the filters are told.

The values are round numbers of what people on foot, riders and drivers do in towns (accelerations
of everyday driving stay below 3 m/s2, braking hard below 6), and of what detectors of LiDAR err
by. They are not fitted to any recording.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["GROUPS", "RoadUser", "group_of"]


@dataclass(frozen=True)
class RoadUser:
    """Road users that move alike; a detection never changes from one group to another.

    Attributes:
        name: of the group.
        classes: of actors (``taxonomy.ACTOR_CLASSES``).
        turns: whether it moves along its heading only, as wheels do; people step to any side.
        place_m: error of a detected centre in plan, standard deviation, metres.
        height_m: error of a detected underside, metres.
        yaw: error of a detected axis, radians.
        accelerates: how fast the speed wanders, (m/s)2 per second.
        swerves: how fast the rate of turn wanders, (rad/s)2 per second; of people the heading
            itself, rad2 per second.
        slips_m: how fast the centre wanders across the heading, metres per root second: a
            vehicle's centre is ahead of its rear axle, which alone follows the heading.
        speed_m_s: standard deviation of a speed of which nothing is known yet.
        fastest_m_s: nobody is faster.
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
    """Return how actors of a class move; of one that is in no table, as vehicles."""
    return _GROUP_OF.get(actor_class, GROUPS[2])
