"""Streets that alignment finds hard, drawn as sketches: a terrace, an avenue and a roundabout.

python benchmarks/alignment_streets.py FOLDER --seed 1
for each in FOLDER/*/site.yaml; do urbantwin build $each -o $(dirname $each)/twin; done
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

#: One thing that is drawn: what it is, and its coordinates.
Drawn = tuple[dict[str, Any], Any]

_SITE = """name: {name}
anchor: {{latitude: 52.2, longitude: 0.12}}
region: {{radius_m: 100}}
sketch: {{file: sketch.geojson, licence: CC0-1.0, attribution: The UrbanTwin authors}}
scene: {{clutter: typical}}
rig:
  rate_hz: 10
  sensors: [{{name: a, model: VLP-16, east_m: 0, north_m: 0, height_m: 5, yaw_deg: 0}}]
"""


def _box(east: float, north: float, wide: float, deep: float) -> list[list[list[float]]]:
    x, y = east + wide * np.array([0, 1, 1, 0, 0]), north + deep * np.array([0, 0, 1, 1, 0])
    return [np.column_stack([x, y]).round(3).tolist()]


def _street(line: Any, **properties: Any) -> Drawn:
    usual = {"kind": "street", "class": "residential", "sidewalk": "both", "lanes": 1}
    return {**usual, "lanes_back": 1, **properties}, np.round(line, 3).tolist()


def terrace(generator: np.random.Generator) -> list[Drawn]:
    """Houses that repeat every few metres along both sides of a street, each with a porch."""
    period = float(generator.uniform(5.0, 9.0))
    gap = float(generator.choice([0.0, 1.2]))
    setback, porch = generator.uniform(7.5, 9.0), 0.35 * period
    drawn = [_street([[-115.0, 0.0], [115.0, 0.0]])]
    house = {"kind": "building", "height_m": 6.5}
    for k in range(int(230 / period)):
        west = -115.0 + k * period
        for side in (-1, 1):
            front = setback if side > 0 else -setback - 9.0
            drawn.append((house, _box(west, front, period - gap, 9.0)))
            out = setback - 1.0 if side > 0 else -setback
            drawn.append(({**house, "height_m": 2.8}, _box(west + 0.4, out, porch, 1.0)))
    return drawn


def avenue(generator: np.random.Generator) -> list[Drawn]:
    """A street without a junction between long plain fronts, rows of trees and lamps."""
    setback = float(generator.uniform(11.0, 15.0))
    drawn = [_street([[-115.0, 0.0], [115.0, 0.0]], **{"class": "secondary", "lanes": 2})]
    drawn[0][0]["lanes_back"] = 2
    for side in (-1, 1):
        front = setback if side > 0 else -setback - 14.0
        west = -115.0
        while west < 115.0:
            wide = float(generator.uniform(45.0, 80.0))
            drawn.append(({"kind": "building", "height_m": 16}, _box(west, front, wide, 14.0)))
            west += wide + float(generator.choice([0.0, 4.0]))
        every, aside = float(generator.uniform(9.0, 14.0)), side * (setback - 2.5)
        tree, lamp = {"kind": "tree", "height_m": 8}, {"kind": "lamp"}
        drawn += [(tree, [float(east), aside]) for east in np.arange(-110.0, 110.0, every)]
        drawn += [(lamp, [float(x), side * (setback - 4.0)]) for x in np.arange(-104, 110, 27)]
    return drawn


def roundabout(generator: np.random.Generator) -> list[Drawn]:
    """A ring with three to five arms, looking much the same from each, and a few houses."""
    arms, radius = int(generator.integers(3, 6)), float(generator.uniform(11.0, 18.0))
    turns = -np.linspace(0.0, 2 * np.pi, 12 * arms + 1)  # driven on the left: clockwise
    ring = radius * np.column_stack([np.cos(turns), np.sin(turns)])
    drawn = [_street(ring, lanes_back=0, **{"osm:junction": "roundabout"})]
    for k in range(arms):
        ahead = ring[12 * k] / radius
        drawn.append(_street([ahead * radius, ahead * 115.0], **{"class": "tertiary"}))
        beside = np.array([-ahead[1], ahead[0]])
        for away in np.arange(radius + 22.0, 90.0, 24.0):
            if generator.random() < 0.6:
                middle = ahead * away + beside * generator.choice([-1, 1]) * 17.0
                size = generator.uniform(8.0, 13.0, 2)
                house = {"kind": "building", "height_m": float(generator.uniform(5, 11))}
                drawn.append((house, _box(*(middle - size / 2), *size)))
    return drawn


KINDS: dict[str, Callable[[np.random.Generator], list[Drawn]]] = {
    "terrace": terrace,
    "avenue": avenue,
    "roundabout": roundabout,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    for number, (kind, draw) in enumerate(KINDS.items()):
        features = []
        for properties, places in draw(np.random.default_rng([given.seed, number])):
            depth = np.ndim(places)
            geometry = {"type": ("Point", "LineString", "Polygon")[depth - 1]}
            geometry["coordinates"] = places
            features.append({"type": "Feature", "properties": properties, "geometry": geometry})
        site = given.folder / f"{kind}-{given.seed}"
        site.mkdir(parents=True, exist_ok=True)
        sketch = {"type": "FeatureCollection", "crs": "site", "features": features}
        (site / "sketch.geojson").write_text(json.dumps(sketch))
        (site / "site.yaml").write_text(_SITE.format(name=site.name))


if __name__ == "__main__":
    main()
