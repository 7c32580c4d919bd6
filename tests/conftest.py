"""Fixtures shared by every test."""

import math
import os
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import settings

SHARED_DATA = Path(__file__).parents[2] / "shared" / "data"

# The same examples in every run; HYPOTHESIS_PROFILE=default looks for new ones.
settings.register_profile("seeded", derandomize=True, database=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "seeded"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of real inputs, which stands beside the checkout."""
    if not SHARED_DATA.is_dir():
        if os.environ.get("CI"):
            pytest.fail(f"{SHARED_DATA} is missing")
        pytest.skip(f"real inputs are not here ({SHARED_DATA})")
    return SHARED_DATA


@pytest.fixture
def write_osm(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes OSM XML: nodes {id: (x, y, tags)}, ways {id: (nodes, tags)}.

    x, y are metres around 48.7 N 9.18 E, on a sphere's tangent plane: good to a few centimetres
    within 300 m.
    """

    def write(nodes: dict, ways: dict, name: str = "map.osm") -> Path:
        root = ElementTree.Element("osm", version="0.6")
        north = 111_194.9
        for identity, (x, y, tags) in nodes.items():
            lat, lon = 48.7 + y / north, 9.18 + x / (north * math.cos(math.radians(48.7)))
            node = ElementTree.SubElement(
                root, "node", id=str(identity), lat=f"{lat:.9f}", lon=f"{lon:.9f}", version="1"
            )
            for key, value in tags.items():
                ElementTree.SubElement(node, "tag", k=key, v=value)
        for identity, (refs, tags) in ways.items():
            way = ElementTree.SubElement(root, "way", id=str(identity), version="1")
            for ref in refs:
                ElementTree.SubElement(way, "nd", ref=str(ref))
            for key, value in tags.items():
                ElementTree.SubElement(way, "tag", k=key, v=value)
        path = tmp_path / name
        ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
        return path

    return write
