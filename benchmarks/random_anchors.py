"""Places of an extract that a seed draws, before anybody looks at them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import shapely

from urbantwin.roads.build import NETWORK_CLASSES
from urbantwin.site import read_extract
from urbantwin.site.extract import Extract

__all__ = ["anchors"]

RADII_M = (80.0, 100.0, 120.0, 150.0)


def anchors(path: Path, seed: int, count: int) -> list[tuple[float, float, float]]:
    """Draw latitude, longitude and radius: signals and junctions in turn."""
    extract = read_extract(path)
    uses = Counter(
        node
        for way in extract.highways()
        if way.tags["highway"] in NETWORK_CLASSES and way.tags.get("area") != "yes"
        for node in way.nodes
        if node in extract.nodes
    )
    low, high = np.percentile(list(extract.nodes.values()), [3, 97], axis=0)
    beside = path.with_name(f"{path.name.split('.')[0]}.boundary.json")
    area = shapely.box(*low, *high)
    if beside.exists():
        area &= shapely.union_all(shapely.get_parts(shapely.from_geojson(beside.read_text())))
    nodes = [node for node in sorted(uses) if area.contains(shapely.Point(extract.nodes[node]))]
    lit = [node for node in nodes if _is_signal(extract, node)]
    meeting = [node for node in nodes if uses[node] > 1]
    random = np.random.default_rng([seed, sum(path.name.encode())])
    found = []
    for k in range(count):
        pool = lit if lit and k % 2 == 0 else meeting
        lon, lat = extract.nodes[pool[int(random.integers(len(pool)))]]
        found.append((round(lat, 6), round(lon, 6), float(random.choice(RADII_M))))
    return found


def _is_signal(extract: Extract, node: int) -> bool:
    tags = extract.node_tags.get(node, {})
    return "traffic_signals" in (tags.get("highway"), tags.get("crossing"))
