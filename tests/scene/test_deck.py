"""Decks of roads over roads: parapets, piers that stand on no road, clearance by casting."""

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.scene.deck import (
    PARAPET_M,
    THICKNESS_M,
    deck_area,
    deck_height,
    deck_mesh,
    deck_pier_mesh,
)
from urbantwin.scene.scene import ON_A_PLAIN
from urbantwin.site import read_extract

from ..thin_rays import cast_static

REGION = shapely.Point(0, 0).buffer(110)


def flat(xy):
    return np.zeros(len(xy))


@pytest.fixture(scope="module")
def crossing(tmp_path_factory):
    """A street under a long bridge."""
    folder = tmp_path_factory.mktemp("deck")
    metre = 1 / 111_194.9
    nodes = {1: (-180, 0), 2: (-70, 0), 3: (70, 0), 4: (180, 0), 5: (0, -110), 6: (0, 110)}
    ways = {
        1: ([1, 2], {"highway": "primary", "lanes": "2"}),
        2: ([2, 3], {"highway": "primary", "lanes": "2", "bridge": "yes", "layer": "1"}),
        3: ([3, 4], {"highway": "primary", "lanes": "2"}),
        4: ([5, 6], {"highway": "residential"}),
    }
    text = ['<osm version="0.6">']
    text += [
        f'<node id="{k}" version="1" lat="{y * metre:.9f}" lon="{9 + x * metre:.9f}"/>'
        for k, (x, y) in nodes.items()
    ]
    for k, (refs, tags) in ways.items():
        inner = "".join(f'<nd ref="{n}"/>' for n in refs)
        inner += "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
        text.append(f'<way id="{k}" version="1">{inner}</way>')
    path = folder / "map.osm"
    path.write_text("".join([*text, "</osm>"]))
    frame = SiteFrame(0.0, 9.0)
    return build_roads(
        read_extract(path),
        frame,
        REGION,
        Elevation.flat(),
        driving_side="right",
        out=folder / "n.net.xml",
        closed_loop=False,
    )


def test_the_street_below_is_clear(crossing):
    """Beams upward from the street: nothing but the underside, 4.5 m and more above it."""
    network, surface = crossing.network, crossing.surface
    mesh = deck_mesh(network, surface, ON_A_PLAIN)
    piers, notes = deck_pier_mesh(network, surface, region=REGION, ground_height=flat)
    assert notes["piers"] >= 2
    below = shapely.intersection(network.carriageway(0), deck_area(network).buffer(1.0))
    street = shapely.intersection(below, shapely.box(-6, -30, 6, 30))
    west, south, east, north = street.bounds
    rng = np.random.default_rng(1)
    spots = rng.uniform([west, south], [east, north], (300, 2))
    spots = spots[shapely.contains_xy(street, *spots.T)]
    assert len(spots) > 100
    lowest = [
        cast_static(mesh, np.array([x, y, 0.1]), np.array([[0.0, 0.0, 1.0]])).range_m[0]
        for x, y in spots[:40]
    ]
    assert np.min(lowest) + 0.1 > 4.5
    foot = piers.vertices[piers.vertices[:, 2] < 0.5]
    assert not shapely.contains_xy(network.carriageway(0), foot[:, 0], foot[:, 1]).any()


def test_piers_reach_from_the_ground_into_the_deck(crossing):
    network, surface = crossing.network, crossing.surface
    piers, _ = deck_pier_mesh(network, surface, region=REGION, ground_height=flat)
    for part in np.unique(piers.part):
        own = piers.select(piers.part == part).vertices
        assert own[:, 2].min() < -0.3
        middle = own[:, :2].mean(axis=0)[None]
        top = deck_height(network, surface, flat)(middle)[0]
        assert top - THICKNESS_M - 0.4 < own[:, 2].max() < top - 0.3


def test_parapets_stand_along_the_whole_deck(crossing):
    network, surface = crossing.network, crossing.surface
    mesh = deck_mesh(network, surface, ON_A_PLAIN)
    height = deck_height(network, surface, flat)
    origin = np.array([0.0, 0.0, height(np.zeros((1, 2)))[0] + 0.6 * PARAPET_M])
    for side in (1.0, -1.0):  # from the middle of the deck to both sides, right over the street too
        way = np.array([[x, side * 8.0, 0.0] for x in np.linspace(-6, 6, 25)])
        hits = cast_static(mesh, origin, way / np.linalg.norm(way, axis=1, keepdims=True))
        assert (hits.face >= 0).all()
        assert (hits.range_m < 12).all()


def test_heights_off_the_decks_are_the_grounds(crossing):
    height = deck_height(crossing.network, crossing.surface, lambda xy: np.full(len(xy), -3.0))
    assert height(np.array([[0.0, 60.0]])) == pytest.approx(-3.0)
    assert height(np.array([[0.0, 0.0]]))[0] > 4.5
