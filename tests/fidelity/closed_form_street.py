"""A street of planes and boxes, scanned by closed forms."""

import numpy as np

from urbantwin.geometry import rotation_from_ypr
from urbantwin.lidar import beam_directions

#: Planes (n, d) with n.x = d: ground that falls to the north by 1.5 %, walls, a slanted one.
PLANES = [
    ((0.0, 0.015, 1.0), 0.0),
    ((0.0, 1.0, 0.0), 22.0),
    ((1.0, 0.2, 0.0), -19.0),
    ((0.9, -0.5, 0.0), 24.0),
]
#: Boxes: centre, size.
BOXES = [((8.0, 9.0, 0.8), (4.2, 1.8, 1.6)), ((-6.0, -9.0, 1.5), (2.0, 2.5, 3.0)),
         ((3.0, -12.0, 1.0), (1.8, 4.4, 2.0)), ((-9.0, 10.0, 2.0), (0.5, 0.5, 4.0))]  # fmt: skip


def ranges(origin, directions):
    """The distance (N,) to the nearest plane or box along rays (N, 3), inf where there is none."""
    nearest = np.full(len(directions), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for normal, level in PLANES:
            along = (level - origin @ normal) / (directions @ np.array(normal))
            nearest = np.where((along > 0.5) & (along < nearest), along, nearest)
        for centre, size in BOXES:
            low = (np.array(centre) - np.array(size) / 2 - origin) / directions
            high = (np.array(centre) + np.array(size) / 2 - origin) / directions
            enter = np.minimum(low, high).max(axis=1)
            leave = np.maximum(low, high).min(axis=1)
            hit = (enter < leave) & (enter > 0.5)
            nearest = np.where(hit & (enter < nearest), enter, nearest)
    return nearest


def scan(model, place, angles_deg, columns, random, phase_deg=0.0, origin_offset_m=0.0):
    """Points (N, 3) of one turn, with 1 cm of noise along the beams, and their rings.

    Beams leave from the sensor's place, or so far above it (of every channel).
    """
    beams = beam_directions(model, columns)
    turned = rotation_from_ypr(*np.radians([angles_deg[0] + phase_deg, *angles_deg[1:]]))
    directions = beams.reshape(-1, 3) @ turned.T
    above = np.repeat(np.broadcast_to(origin_offset_m, model.channels), columns)
    origin = np.array(place) + above[:, None] * turned[:, 2]
    far = ranges(origin, directions)
    near = far < 60
    far = far[near] + random.normal(0, 0.01, near.sum())
    ring = np.repeat(np.arange(model.channels), columns)[near]
    return origin[near] + directions[near] * far[:, None], ring
