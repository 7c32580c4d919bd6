"""Heights of roads: on the ground, bounded by it, smooth over junctions, falling as real ones."""

import itertools
import json
import sqlite3
from dataclasses import replace

import laspy
import numpy as np
import pytest
import shapely
from scipy.ndimage import distance_transform_edt, gaussian_filter
from scipy.stats import binned_statistic_2d

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads, driving_side
from urbantwin.roads.grade_separation import Lift
from urbantwin.roads.heights import RoadSurface, with_heights
from urbantwin.roads.imported.heights import ModelSurface
from urbantwin.roads.model import (
    LaneModel,
    LaneSection,
    ModelRoad,
    Profile,
    RoadLink,
    SectionLane,
    filleted,
)
from urbantwin.site import read_extract

from ..real_files import argoverse_map, osm_extract
from ..thorough import further

ZERO = Profile.constant(0.0)
LEVEL = Lift(np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0))
HALF = 160.0
AXIS = np.arange(-HALF, HALF + 1.0)
X, Y = np.meshgrid(AXIS, AXIS)
HILLS = 0.03 * X + 1.6 * np.sin(Y / 35) * np.cos(X / 40)
PLACES = {
    "taipei": (25.052396, 121.522635),
    "neukolln": (52.47328, 13.439643),
    "perth_stretched_lights": (-31.974855, 115.897588),
}


def ground(z, source=0.0):
    return Elevation(-HALF, -HALF, 1.0, z, source)


def street(points, left=3.5, right=3.5, *, kind="residential", joined=False, number=1):
    """A street along points: lanes ``left`` and ``right`` metres wide, either may be 0."""
    lanes = []
    if left:
        lanes.append(SectionLane(1, "driving", Profile.constant(left), False, 13.9, ("car",)))
    if right:
        lanes.append(SectionLane(-1, "driving", Profile.constant(right), True, 13.9, ("car",)))
    link = RoadLink("junction", 99) if joined else None
    return ModelRoad(
        number, "", kind, (), -1, filleted(np.array(points, float), left=left, right=right),
        ZERO, ZERO, ZERO, ZERO, (LaneSection(0.0, tuple(lanes)),), link, link,
    )  # fmt: skip


def raised(*roads, elevation, side="right"):
    return with_heights(LaneModel(side, roads), elevation, LEVEL)[0].roads


def across(road, s, reach=3.0):
    """Slopes from the reference line outwards, to the right and to the left."""
    z = road.heights([s] * 3, np.array([-reach, 0.0, reach]))
    return (z[0] - z[1]) / reach, (z[2] - z[1]) / reach


def test_a_two_way_street_sheds_water_to_both_sides():
    (road,) = raised(street([[-60, 0], [60, 0]], joined=True), elevation=Elevation.flat())
    assert across(road, 60.0) == pytest.approx((-0.02, -0.02), abs=1e-6)
    for s in (0.0, road.length):  # at junctions it is level
        assert across(road, s) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert road.elevation.at(np.linspace(0, 120, 50)) == pytest.approx(0.0, abs=1e-6)
    # An end where the map ends stays as it is.
    (road,) = raised(street([[-60, 0], [60, 0]]), elevation=Elevation.flat())
    assert across(road, 0.0) == pytest.approx((-0.02, -0.02), abs=1e-6)


@pytest.mark.parametrize(("left", "right", "sign"), [(0, 7, 1), (7, 0, -1)])
def test_a_one_way_carriageway_falls_to_its_outer_side(left, right, sign):
    (road,) = raised(street([[-60, 0], [60, 0]], left, right), elevation=Elevation.flat())
    assert np.tan(road.bank.at(60.0)[0]) == pytest.approx(sign * 0.02, abs=1e-4)
    assert road.crown.is_zero


@pytest.mark.parametrize(("crown", "bank"), [(0.03, 0.0), (0.0, 0.04), (0.02, -0.025)])
def test_cross_fall_is_measured_where_the_ground_shows_it(crown, bank):
    """A carriageway of 8 m with curbs in noisy ground, parked cars here and there."""
    noise = np.random.default_rng(4)
    z = 0.03 * X + bank * Y - crown * np.abs(Y) + 0.15 * (np.abs(Y) > 4.2)
    z = z + noise.normal(0.0, 0.03, X.shape)
    z[(np.abs(Y - 3) < 1) & (np.sin(X) > 0.9)] += 1.4
    (road,) = raised(street([[-60, 0], [60, 0]], 4, 4), elevation=ground(z))
    for s in (30.0, 60.0, 90.0):
        assert np.tan(road.bank.at(s)[0]) == pytest.approx(bank, abs=0.008)
        assert road.crown.at(s)[0] == pytest.approx(crown, abs=0.008)
        assert road.elevation.at(s)[0] == pytest.approx(0.03 * (s - 60), abs=0.04)


def test_ground_too_coarse_to_show_it_leaves_the_usual_cross_fall():
    (road,) = raised(street([[-60, 0], [60, 0]]), elevation=ground(0.03 * X, source=5.0))
    assert road.crown.at(60.0)[0] == pytest.approx(0.02)


def test_a_canal_beside_a_street_does_not_tilt_it():
    z = np.where(Y < -4.5, -2.0, 0.0)
    (road,) = raised(street([[-60, 0], [60, 0]], 4, 4), elevation=ground(z))
    s, t = np.meshgrid(np.linspace(0, 120, 25), np.linspace(-4, 4, 9))
    assert np.abs(road.heights(s.ravel(), t.ravel())).max() < 0.06


def test_a_car_that_is_parked_in_the_dem_leaves_no_bump():
    """One of 4.4 m x 1.8 m x 1.5 m on the right-hand lane."""
    car = 1.5 * ((np.abs(X) < 2.2) & (np.abs(Y + 2.0) < 0.9))
    (road,) = raised(street([[-60, 0], [60, 0]]), elevation=ground(car))
    s, t = np.meshgrid(np.linspace(0, 120, 121), np.linspace(-3.5, 3.5, 8))
    assert road.heights(s.ravel(), t.ravel()).max() < 0.15


def test_a_terrace_becomes_a_ramp_that_its_class_allows():
    """A step of 1 m in a coarse DEM: 8 % where it is only filtered, a motorway has at most 6 %."""
    z = np.where(X > 0, 1.0, 0.0)
    for kind in ("motorway", "residential"):
        (road,) = raised(street([[-100, 0], [100, 0]], 0, 7, kind=kind), elevation=ground(z, 5.0))
        s = np.linspace(0, 200, 800)
        assert np.abs(road.elevation.slope(s)).max() < 0.06
        # Crests for 50 km/h: radius 700 m (AASHTO 2018, table 3-35: K = 7), or all that is left
        # with cuts of half a metre.
        assert np.abs(np.diff(road.elevation.slope(s)) / np.diff(s)).max() < 1 / 250
        assert np.abs(road.elevation.at([5.0, 195.0]) - [0.0, 1.0]).max() < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_no_street_is_steeper_than_the_ground_along_it(seed):
    """Rough ground, smoothed by a filter of our own; tolerance: 1 % of grade."""
    noise = np.random.default_rng(seed)
    z = HILLS + gaussian_filter(noise.normal(0, 1.0, X.shape), 3.0) * 2.0
    angle = noise.uniform(0, np.pi, 4)
    lines = [
        np.linspace(-1, 1, 9)[:, None] * 130 * np.array([[np.cos(a), np.sin(a)]])
        + noise.normal(0, 2, (9, 2))
        for a in angle
    ]
    fine = ground(z)
    calm = gaussian_filter(z, 3.0)
    north, east = np.gradient(calm)
    grade = Elevation(-HALF, -HALF, 1.0, np.hypot(north, east))
    for k, line in enumerate(lines):
        (road,) = raised(street(line, joined=bool(k % 2)), elevation=fine)
        s = np.arange(1.0, road.length - 1.0, 0.5)
        around = road.curve.at(s)[:, :2]
        steepest = grade.raw_at(around).max()
        for t in (-3.0, 0.0, 3.0):
            z = road.heights(s, np.full(len(s), t))
            assert np.abs(np.diff(z) / 0.5).max() <= steepest + 0.01


@pytest.fixture(scope="module", params=["perth_stretched_lights", *further("taipei", "neukolln")])
def on_hills(request, shared_data, tmp_path_factory):
    frame = SiteFrame(*PLACES[request.param])
    extract = read_extract(osm_extract(shared_data, request.param))
    return build_roads(
        extract, frame, shared_region(), ground(HILLS),
        driving_side=driving_side(*PLACES[request.param]),
        out=tmp_path_factory.mktemp(request.param) / "n.net.xml",
    )  # fmt: skip


def shared_region():
    return shapely.Point(0, 0).buffer(120)


def test_grades_are_the_grounds_on_every_lane(on_hills):
    """Along reference lines and every lane's middle, ways through junctions too.

    Tolerance: 1 % of grade on reference lines. Where lanes wind round their reference line, or
    carriageways overlap, one in a thousand metres of lane may be steeper.
    """
    steepest = np.hypot(*np.gradient(HILLS)).max()
    lanes, lengths = [], []
    for road in on_hills.model.roads:
        s = np.linspace(0.0, road.length, max(3, int(road.length)))
        assert np.abs(road.elevation.slope(s)).max() < steepest + 0.01, road.id
        for section, end in zip(road.sections, road.section_ends, strict=True):
            for lane in section.lanes:
                s = np.linspace(section.s, end, max(3, int(end - section.s)))
                place = road.place(s, road.middle(section, lane, s))
                run = np.linalg.norm(np.diff(place[:, :2], axis=0), axis=1)
                lanes.append(np.abs(np.diff(place[:, 2]))[run > 0.3] / run[run > 0.3])
                lengths.append(run[run > 0.3])
    grade, length = np.concatenate(lanes), np.concatenate(lengths)
    assert length[grade > steepest + 0.015].sum() < 1e-3 * length.sum()


def test_ways_through_junctions_go_on_without_a_step_or_a_kink(on_hills):
    """At both ends, on both borders of the lane: 1 mm, and 0.5 % of grade."""
    roads = on_hills.model.road_by_id
    count = 0
    for way in on_hills.model.roads:
        # A lane cannot turn back within less than its own width: such ways fold over.
        if way.junction < 0 or way.length < 2.0:
            continue
        lane = way.sections[0].lanes[0]
        for s, link in ((0.0, way.predecessor), (way.length, way.successor)):
            other = roads[link.id]
            at = other.length if link.contact == "end" else 0.0
            borders = [way.border(way.sections[0], lane, [s], outer=k)[0] for k in (False, True)]
            ends = way.place([s] * 2, borders)
            t = other.curve.locate(ends[:, :2])[1]
            height = other.heights([at] * 2, t)
            assert np.abs(height - ends[:, 2]).max() < 1e-3, way.id
            # The slope over the last 5 mm of either road.
            back = 0.005
            inner = way.place([abs(s - back)] * 2, borders)
            run = np.linalg.norm((inner - ends)[:, :2], axis=1)
            steps = [other.curve.beside([x] * 2, t) for x in (abs(at - back), at)]
            there = np.linalg.norm(steps[0] - steps[1], axis=1)
            before = other.heights([abs(at - back)] * 2, t)
            # On the inside of a tight turn a border has no length: no slope either.
            wide = (run > 0.4 * back) & (there > 0.4 * back)
            slope = (ends[:, 2] - inner[:, 2])[wide] / run[wide]
            onward = (before - height)[wide] / there[wide]
            assert np.abs(slope - onward).max(initial=0.0) < 5e-3, way.id
            count += 1
    assert count > 10


def test_the_surface_of_a_map_with_heights_of_its_own_is_the_maps(town):
    model = town("right")
    surface = RoadSurface(model, ModelSurface(model))
    for road in model.roads:
        s = np.linspace(0.1, road.length - 0.1, 40)
        for section, lane in itertools.product(road.sections[:1], road.sections[0].lanes):
            inside = s < road.section_ends[0]
            place = road.place(s[inside], road.middle(section, lane, s[inside]))
            off = surface.height(place[:, :2], road.level) - place[:, 2]
            assert np.abs(off).max() < 0.02, (road.id, lane.id)


def plane_through(points, s, t):
    """Height, grade, bank by least squares."""
    design = np.column_stack([np.ones(len(s)), s - s.mean(), t])
    return np.linalg.lstsq(design, points, rcond=None)[0]


DELFT = [  # carriageways along canals, from end to end, EPSG:28992 less the origin below
    ([-38.0, -12.9], [29.5, 40.5]),
    ([49.6, 39.0], [100.9, -7.5]),
    ([-112.5, 20.0], [-59.0, -12.3]),
    ([37.0, -76.4], [74.0, -85.4]),
]


@pytest.mark.thorough
def test_streets_lie_as_airborne_lidar_sees_them(shared_data):
    """Delft: a 1 m raster of the ground's points; judged by the points themselves."""
    folder = shared_data / "airborne" / "delft-ahn3"
    origin = np.array([84940.0, 447527.0])
    clouds = []
    for path in sorted((folder / "ahn3").glob("*.laz")):
        las = laspy.read(path)
        earth = np.asarray(las.classification) == 2
        clouds.append(np.column_stack([las.x, las.y, las.z])[earth])
    cloud = np.concatenate(clouds) - [*origin, 0.0]
    x, y = np.arange(-132.5, 133), np.arange(-114.5, 115)
    z = binned_statistic_2d(cloud[:, 1], cloud[:, 0], cloud[:, 2], "mean", bins=[y, x]).statistic
    near = distance_transform_edt(np.isnan(z), return_distances=False, return_indices=True)
    elevation = Elevation(-132.0, -114.0, 1.0, z[tuple(near)])
    blurred = replace(elevation, raw=gaussian_filter(elevation.raw, 5.0, mode="nearest"))
    table = sqlite3.connect(folder / "bgt" / "bgt_wegdeel.sqlite").execute(
        "select GEOMETRY from trafficarea where function='rijbaan lokale weg'"
        " and terminationdate is null"
    )
    shapes = [shapely.force_2d(shapely.from_wkb(bytes(row[0]))) for row in table]
    official = shapely.union_all([s for s in shapes if s.geom_type == "Polygon" and s.area > 200])
    official = shapely.affinity.translate(official, *-origin)
    gaps, fitted, filtered = [], [], []
    for first, last in np.array(DELFT):
        ahead = (last - first) / np.linalg.norm(last - first)
        cut = shapely.LineString([(first + last) / 2 + k * ahead[::-1] * [-1, 1] for k in (-8, 8)])
        width = float(shapely.intersection(cut, official).length)
        middle = shapely.intersection(cut, official).centroid
        shift = np.array([middle.x, middle.y]) - (first + last) / 2
        line = street([first + shift, last + shift], width / 2, width / 2)
        (road,) = raised(line, elevation=elevation)
        s, t = road.curve.locate(cloud[:, :2])
        on = (s > 5) & (s < road.length - 5) & (np.abs(t) < width / 2 - 0.4)
        assert on.sum() > 500
        off = cloud[on, 2] - road.heights(s[on], t[on])
        assert np.sqrt((off**2).mean()) < 0.03
        fitted.append(off)
        filtered.append(cloud[on, 2] - blurred.raw_at(cloud[on, :2]))
        for station in np.arange(15.0, road.length - 15.0, 10.0):
            here = on & (np.abs(s - station) < 6.0)
            bank = plane_through(cloud[here, 2], s[here], t[here])[2]
            gaps.append(abs(np.tan(road.bank.at(station)[0]) - bank))
    # A filter alone, which knows no roads, is twice as far off.
    spread = [np.sqrt((np.concatenate(parts) ** 2).mean()) for parts in (fitted, filtered)]
    assert spread[0] < 0.5 * spread[1]
    assert np.median(gaps) < 0.007
    assert max(gaps) < 0.02


def test_lanes_lie_across_as_surveyors_mapped_them(shared_data):
    """Argoverse, Pittsburgh: fitted to the ground raster, judged by the lanes' mapped borders."""
    raster = np.load(argoverse_map(shared_data, "heights")).astype(np.float64)
    move = json.loads(argoverse_map(shared_data, "to_cells").read_text())
    lanes = json.loads(argoverse_map(shared_data, "lanes").read_text())["lane_segments"]
    origin = np.array([5224.0, 2385.0])
    near = distance_transform_edt(np.isnan(raster), return_distances=False, return_indices=True)
    corner = -np.array(move["t"]) - origin + 0.5 / move["s"]
    elevation = Elevation(*corner, 1.0 / move["s"], raster[tuple(near)])
    height = float(elevation.raw_at([[0.0, 0.0]])[0])
    elevation = Elevation(*corner, 1.0 / move["s"], raster[tuple(near)] - height)
    banks, levels = [], []
    for lane in lanes.values():
        left, right = (
            np.array([[p[k] for k in "xyz"] for p in lane[f"{side}_lane_boundary"]])
            - [*origin, height]
            for side in ("left", "right")
        )
        line = shapely.LineString(left[:, :2])
        if lane["is_intersection"] or line.length < 15 or np.hypot(*left[:, :2].mean(0)) > 60:
            continue
        width = float(np.median(shapely.distance(shapely.points(right[:, :2]), line)))
        (road,) = raised(street(left[:, :2], 0, width), elevation=elevation)
        s = np.arange(1.0, road.length - 1.0)
        heights = []
        for border in (left, right):
            along = road.curve.locate(border[:, :2])[0]
            order = np.argsort(along)
            heights.append(np.interp(s, along[order], border[order, 2]))
        mapped = (heights[0] - heights[1]) / width
        banks.append(np.mean(np.tan(road.bank.at(s)) - mapped))
        levels.append(np.median(road.heights(s, -width) - heights[1]))
    # The raster's heights are half floats: at 70 m they come in steps of 6 cm.
    assert len(banks) >= 5
    assert np.median(np.abs(banks)) < 0.012
    assert np.median(np.abs(levels)) < 0.07
