"""Steps of footways: treads from the lower to the higher end of the ground."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Geometry, LineString, Polygon
from shapely.ops import substring

from urbantwin.scene.slab import plain_polygons, slab
from urbantwin.scene.solids import Assembly, GroundHeight
from urbantwin.scene.tag_values import count_of, length_m_of
from urbantwin.site.extract import OsmFeature

__all__ = ["add_steps", "is_flight"]

#: Usual and maximum width of a flight; usual height of a riser (2 r + g = 63 cm), and its range,
#: metres.
WIDTH_M, WIDEST_M, RISER_M, RISERS_M = 2.0, 30.0, 0.16, (0.08, 0.25)
#: Ground that rises by less from end to end needs no steps, metres.
LEAST_RISE_M = 0.3
KERB_M, BURIED_M = 0.3, 0.3


def is_flight(tags: dict[str, str]) -> bool:
    """Return whether a feature is steps on the ground in the open."""
    indoors = any(tags.get(key, "no") != "no" for key in ("tunnel", "bridge", "indoor", "covered"))
    level = tags.get("layer", "0") == "0" and not tags.get("level", "0").startswith("-")
    return tags.get("highway") == "steps" and level and not indoors


def add_steps(
    assembly: Assembly,
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    notes: Counter[str],
) -> None:
    """Add the mapped flights, with the height of the ground at their ends.

    The ground model has a slope there; each tread has the height of the upper end of its part of
    the slope.
    """
    free = region.difference(carriageway.buffer(KERB_M))
    for feature in features:
        for line in shapely.get_parts(feature.geometry.intersection(free)):
            if not isinstance(line, LineString) or line.length < RISER_M:
                continue
            ends = ground_height(shapely.get_coordinates(line)[[0, -1]])
            rise = float(abs(ends[1] - ends[0]))
            if not rise >= LEAST_RISE_M:  # nor where no ground is known
                notes["steps where the ground is level, not drawn"] += 1
                continue
            count = count_of(feature.tags.get("step_count"))
            if not count or not RISERS_M[0] <= rise / count <= RISERS_M[1]:
                count = max(round(rise / RISER_M), 2)
            wide = min(length_m_of(feature.tags.get("width")) or WIDTH_M, WIDEST_M)
            upward = line if ends[1] > ends[0] else line.reverse()
            _add(assembly, upward, float(ends.min()), rise, int(count), wide)
            notes["flights of steps"] += 1


def _add(
    assembly: Assembly, line: LineString, low_m: float, rise_m: float, count: int, wide_m: float
) -> None:
    part = assembly.new_part()
    shares = np.linspace(0.0, 1.0, count + 1)
    for start, end in itertools.pairwise(shares):
        run = substring(line, float(start), float(end), normalized=True)
        tread = run.buffer(wide_m / 2, cap_style="flat", join_style="mitre")
        top = low_m + rise_m * float(end)
        for one in plain_polygons(tread, smallest_m2=0.01):
            solid = slab(one, low_m + rise_m * float(start) - BURIED_M, top)
            assembly.add(solid, "sidewalk", "concrete", part)
