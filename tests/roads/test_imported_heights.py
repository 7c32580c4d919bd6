"""Heights that a map brings along."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads.imported import ImportedMap, build_imported_roads, prepared_map
from urbantwin.roads.imported.heights import ModelSurface, elevation_of_model, is_flat, with_levels
from urbantwin.roads.model import LaneModel, Profile, RoadLink, splined

from .tee import EAST, SOUTH, WEST, tee

SLOPE = (0.03, -0.01)
REGION = shapely.Point(0.0, 0.0).buffer(90.0)


def plane(xy):
    return xy[:, 0] * SLOPE[0] + xy[:, 1] * SLOPE[1]


def raised(model, by):
    return model.with_roads(
        tuple(
            dataclasses.replace(
                road,
                elevation=Profile(
                    road.elevation.start, road.elevation.abcd + np.array([by, 0.0, 0.0, 0.0])
                ),
            )
            for road in model.roads
        )
    )


def bridge(height):
    """A street over the eastern one, ``height`` above it at the crossing."""
    return dataclasses.replace(
        tee().road_by_id[EAST],
        id=7,
        name="Bridge",
        predecessor=None,
        elevation=Profile.constant(height),
        curve=splined(np.array([[60.0, -70], [60, 70]]), math.pi / 2, math.pi / 2),
    )


def test_a_map_on_a_slope_keeps_it_and_the_anchor_is_at_zero():
    """The map says 245 m above the sea; its middle is the anchor."""
    imported = ImportedMap(Path("map.xodr"), raised(tee(slope=SLOPE), 245.0))
    prepared = prepared_map(imported, REGION, None)
    assert prepared.notes["heights"] == "the map's own"
    assert prepared.notes["heights_moved_by_m"] == pytest.approx(-245.0, abs=0.05)
    shift = prepared.notes["heights_moved_by_m"] + 245.0
    for road in prepared.model.roads:
        s = np.linspace(0.0, road.length, 30)
        for t in (-3.0, 0.0, 3.0):
            xyz = road.place(s, t)
            assert np.abs(xyz[:, 2] - plane(xyz[:, :2]) - shift).max() < 0.01
    # The ground that goes with it is that plane too, on roads and beside them.
    random = np.random.default_rng(1)
    xy = random.uniform(-60.0, 60.0, (300, 2))
    xy = xy[(xy[:, 1] < 4.0) & (np.abs(xy[:, 0]) + np.abs(xy[:, 1]) < 80.0)]
    found = prepared.elevation.raw_at(xy) - shift
    assert np.abs(found - plane(xy)).max() < 0.02


def test_lanes_of_the_network_have_the_maps_heights(tmp_path):
    prepared = prepared_map(
        ImportedMap(Path("m.xodr"), tee(slope=SLOPE, signals=True)), REGION, None
    )
    roads = build_imported_roads(prepared, SiteFrame(50.0, 8.0), out=tmp_path / "n.net.xml")
    shift = prepared.notes["heights_moved_by_m"]
    kinds = set()
    for lane in roads.network.lanes:
        gap = lane.centre[:, 2] - plane(lane.centre[:, :2]) - shift
        assert np.abs(gap).max() < 0.02, (lane.id, lane.kind)
        kinds.add(lane.kind)
    assert {"driving", "sidewalk", "connection", "crossing", "walkingarea"} <= kinds


def test_with_a_dem_the_map_lies_on_it_on_average():
    """Other heights of the same place: the whole map is moved, not bent."""
    grid = np.add.outer(np.arange(-120.0, 121.0) * SLOPE[1], np.arange(-120.0, 121.0) * SLOPE[0])
    dem = Elevation(-120.0, -120.0, 1.0, grid)
    prepared = prepared_map(
        ImportedMap(Path("m.xodr"), raised(tee(slope=SLOPE), 40.0)), REGION, dem
    )
    assert prepared.elevation is dem
    assert prepared.notes["heights_moved_by_m"] == pytest.approx(-40.0, abs=0.01)


def test_a_flat_map_takes_the_dems_heights():
    grid = np.add.outer(np.arange(-140.0, 141.0) * SLOPE[1], np.arange(-140.0, 141.0) * SLOPE[0])
    dem = Elevation(-140.0, -140.0, 1.0, grid)
    prepared = prepared_map(ImportedMap(Path("m.xodr"), raised(tee(), 12.0)), REGION, dem)
    assert prepared.notes["heights"].startswith("the DEM's")
    for road in prepared.model.roads:
        s = np.linspace(0.0, road.length, 20)
        xyz = road.place(s, 0.0)
        assert np.abs(xyz[:, 2] - plane(xyz[:, :2])).max() < 0.1, road.id


def test_a_flat_map_without_a_dem_is_flat():
    prepared = prepared_map(ImportedMap(Path("m.xodr"), raised(tee(), 12.0)), REGION, None)
    assert is_flat(prepared.model)
    assert prepared.elevation.is_flat
    assert all(road.elevation.at([0.0])[0] == pytest.approx(0.0) for road in prepared.model.roads)


@pytest.mark.parametrize(("height", "level"), [(6.0, 1), (1.0, 0)])
def test_what_passes_over_is_on_a_level_of_its_own(height, level):
    model = tee(slope=(0.0, 0.001))
    model = with_levels(model.with_roads((*model.roads, bridge(height))))
    levels = {road.id: road.level for road in model.roads}
    assert levels.pop(7) == level
    assert set(levels.values()) == {0}


def test_the_ground_passes_under_a_bridge_and_meets_its_ends():
    ramp = Profile(np.array([0.0]), np.array([[0.0, 0.0, 0.0, 0.0]]))
    over = dataclasses.replace(bridge(0.0), elevation=ramp)
    # Up from 0 to 6 m over 50 m, level over the street, and down again.
    start = np.array([0.0, 50.0, 90.0])
    abcd = np.array([[0, 6 / 50, 0, 0], [6.0, 0, 0, 0], [6.0, -6 / 50, 0, 0]])
    over = dataclasses.replace(over, elevation=Profile(start, abcd))
    model = tee(slope=(0.0, 1e-3))
    model = with_levels(model.with_roads((*model.roads, over)))
    ground = elevation_of_model(model, REGION)
    street = np.column_stack([np.linspace(50.0, 70.0, 20), np.zeros(20)])
    assert np.abs(ground.raw_at(street)).max() < 0.05
    ramps = np.column_stack([np.full(20, 60.0), np.linspace(-60.0, -30.0, 20)])
    rise = ModelSurface(model)(ramps, 1)
    assert np.abs(ground.raw_at(ramps) - rise).max() < 0.2
    assert rise.min() > 1.0


def test_a_map_elsewhere_is_refused_with_the_distance():
    imported = ImportedMap(Path("map.xodr"), tee(at=(3000.0, 0.0)))
    with pytest.raises(InputError, match=r"map\.xodr: has no road within.*nearest is 2\.8 km away"):
        prepared_map(imported, REGION, None)


def test_a_map_without_lanes_to_drive_on_is_refused():
    model = tee()
    walks = tuple(
        dataclasses.replace(
            road,
            sections=tuple(
                dataclasses.replace(
                    section,
                    lanes=tuple(dataclasses.replace(x, kind="sidewalk") for x in section.lanes),
                )
                for section in road.sections
            ),
        )
        for road in model.roads
    )
    with pytest.raises(InputError, match="no lanes that traffic could use"):
        prepared_map(ImportedMap(Path("m.xodr"), model.with_roads(walks)), REGION, None)


def test_links_to_what_is_not_there_are_no_reason_to_fail(tmp_path):
    """A reader may leave an end loose; the network has an end there."""
    model = tee()
    loose = dataclasses.replace(model.road_by_id[SOUTH], predecessor=RoadLink("road", 999, "end"))
    others = tuple(road for road in model.roads if road.id != SOUTH)
    model = LaneModel("right", (*others, loose), model.junctions, model.areas)
    prepared = prepared_map(ImportedMap(Path("m.xodr"), model), REGION, None)
    roads = build_imported_roads(prepared, SiteFrame(50.0, 8.0), out=tmp_path / "n.net.xml")
    assert {road.id for road in roads.network.roads} >= {f"{SOUTH}", f"-{SOUTH}", f"{WEST}#1"}
