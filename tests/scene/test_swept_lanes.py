"""Nothing stands on a lane: at a bridge that begins close to streets under it, and in general."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from urbantwin.geometry import LabelledMesh, SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import RoadNetwork, build_roads
from urbantwin.scene import build_scene
from urbantwin.scene.swept_lanes import SweptLanes
from urbantwin.site import read_extract
from urbantwin.taxonomy import material_id, semantic_id

REGION = shapely.Point(0, 0).buffer(110)
#: What counts as standing on a lane: between these heights above it, off its borders, metres.
LOW_M, HIGH_M, BORDER_M = 0.2, 3.0, 0.5


def standing_on_lanes(mesh: LabelledMesh, network: RoadNetwork) -> list[tuple[str, float, float]]:
    """Points of triangles above lanes, found by sampling each triangle: (lane, x, height above)."""
    corners = mesh.triangles()
    boxes = shapely.box(*corners[..., :2].min(axis=1).T, *corners[..., :2].max(axis=1).T)
    tree = shapely.STRtree(boxes)
    found = []
    for lane in network.lanes:
        if lane.kind not in ("driving", "connection") or "car" not in lane.allowed:
            continue
        narrowest = lane.widths.min() if len(lane.widths) else lane.width
        for a, b in zip(lane.centre[:-1], lane.centre[1:], strict=True):
            way, strip = (b - a)[:2], shapely.LineString([a[:2], b[:2]])
            if strip.length < 1e-3 or narrowest / 2 <= BORDER_M:
                continue
            strip = strip.buffer(narrowest / 2 - BORDER_M, cap_style="flat")
            for p, q, r in corners[tree.query(strip)]:
                if max(p[2], q[2], r[2]) < min(a[2], b[2]) + LOW_M:
                    continue
                if min(p[2], q[2], r[2]) > max(a[2], b[2]) + HIGH_M:
                    continue
                side = max(np.linalg.norm(q - p), np.linalg.norm(r - p), np.linalg.norm(r - q))
                steps = np.linspace(0, 1, 2 + min(int(side / 0.3), 200))
                u, v = np.meshgrid(steps, steps)
                u, v = (one[u + v <= 1.0][:, None] for one in (u, v))
                points = p + u * (q - p) + v * (r - p)
                points = points[shapely.contains_xy(strip, points[:, 0], points[:, 1])]
                along = np.clip((points[:, :2] - a[:2]) @ way / (way @ way), 0.0, 1.0)
                above = points[:, 2] - (a[2] + along * (b[2] - a[2]))
                bad = (above > LOW_M) & (above < HIGH_M)
                found += [(lane.id, *row) for row in np.column_stack([points[:, 0], above])[bad]]
    return found


def map_file(folder: Path, nodes: dict, ways: dict) -> Path:
    """Write nodes {id: (x, y, tags)} about 48.7 N 9.18 E and ways {id: (nodes, tags)}."""
    lines = ['<osm version="0.6">']
    for k, (x, y, tags) in nodes.items():
        place = f'lat="{48.7 + y / 111_194.9:.9f}" lon="{9.18 + x / 73_391.0:.9f}"'
        inner = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
        lines.append(f'<node id="{k}" version="1" {place}>{inner}</node>')
    for k, (refs, tags) in ways.items():
        inner = "".join(f'<nd ref="{n}"/>' for n in refs)
        inner += "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
        lines.append(f'<way id="{k}" version="1">{inner}</way>')
    path = folder / "map.osm"
    path.write_text("".join([*lines, "</osm>"]))
    return path


@pytest.fixture(scope="module")
def bridge(tmp_path_factory: pytest.TempPathFactory):
    """A street on a bridge that begins 3 m beside the wide street under it, at an angle."""
    nodes = {
        1: (-180, 0, {}), 2: (-30, 0, {}), 3: (30, 0, {}), 4: (180, 0, {}),
        5: (-110, -90, {}), 6: (110, 90, {}),
        7: (-33, 20, {}), 8: (-33, -20, {}), 9: (33, 2, {"highway": "street_lamp"}),
    }  # fmt: skip
    main = {"highway": "primary", "lanes": "4", "sidewalk": "both"}
    ways = {
        1: ([1, 2], main),
        2: ([2, 3], {**main, "bridge": "yes", "layer": "1"}),
        3: ([3, 4], main),
        4: ([5, 6], {"highway": "secondary", "lanes": "4"}),
        5: ([7, 8], {"barrier": "fence"}),
    }
    folder = tmp_path_factory.mktemp("bridge")
    extract = read_extract(map_file(folder, nodes, ways))
    frame = SiteFrame(48.7, 9.18)
    built = build_roads(
        extract, frame, REGION, Elevation.flat(), driving_side="right",
        out=folder / "n.net.xml", closed_loop=False,
    )  # fmt: skip
    features = extract.features(frame, REGION.buffer(150.0))
    return built.network, build_scene(
        built.network, built.surface, Elevation.flat(), REGION, features, clutter="typical"
    )


def test_nothing_stands_on_the_lanes_of_a_bridge_and_under_it(bridge) -> None:
    network, scene = bridge
    deck = [lane for lane in network.lanes if lane.level == 1 and lane.kind == "driving"]
    assert deck
    assert min(lane.centre[:, 2].max() for lane in deck) > 5.0
    assert standing_on_lanes(scene.mesh, network) == []


def test_a_street_under_the_end_of_a_bridge_is_level(bridge) -> None:
    """The wide street passes 3 m beside both ends of the bridge: it stays on the ground there."""
    network, _ = bridge
    (below,) = {road.id for road in network.roads if 4 in road.ways and "-" not in road.id}
    lanes = [lane for lane in network.lanes if lane.road == below and lane.kind == "driving"]
    assert lanes
    assert max(np.abs(lane.centre[:, 2]).max() for lane in lanes) < 0.3


def wall(x: float, half_m: float, low_m: float, high_m: float) -> LabelledMesh:
    """A wall across a street along x."""
    corners = [(x, y, z) for y in (-half_m, half_m) for z in (low_m, high_m)]
    faces = np.array([[0, 1, 3], [0, 3, 2]], np.int32)
    kinds = semantic_id("other-structure"), material_id("concrete")
    return LabelledMesh.build(np.array(corners, np.float64), faces, *kinds)


def test_a_wall_across_lanes_is_cut_away_above_them_alone(bridge) -> None:
    network, _ = bridge
    lanes = SweptLanes(network)
    across = wall(-70.0, 30.0, -1.0, 8.0)
    height = float(max(lane.centre[:, 2].max() for lane in network.lanes if lane.level == 1))
    assert standing_on_lanes(across, network)
    rest, count = lanes.clear(across)
    assert count == 2
    assert standing_on_lanes(rest, network) == []
    # Beside the street, and higher than vehicles, it still stands.
    corners = rest.triangles()
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    beside = np.abs(corners[..., 1]).min(axis=1) > 9.0
    assert area[beside].sum() > 0.9 * 2 * (30.0 - 9.0) * 9.0 - 60.0
    assert (corners[..., 2].min(axis=1) > height).any()
    # What is nowhere near a lane is returned as it is.
    away = wall(-70.0, 2.0, 9.0, 10.0)
    assert lanes.clear(away) == (away, 0)


@pytest.mark.thorough
@pytest.mark.real
def test_nothing_stands_on_the_lanes_of_a_motorway_over_a_junction(shared_data, tmp_path) -> None:
    """Leeds: two carriageways and a slip road on bridges, skew over a signalised junction."""
    extract = read_extract(shared_data / "osm/leeds_cycleway.osm")
    frame, region = SiteFrame(53.7995539, -1.5336681), shapely.Point(0, 0).buffer(136)
    built = build_roads(
        extract, frame, region, Elevation.flat(), driving_side="left", out=tmp_path / "n.net.xml",
        closed_loop=True,
    )  # fmt: skip
    features = extract.features(frame, region.buffer(150.0))
    scene = build_scene(
        built.network, built.surface, Elevation.flat(), region, features, clutter="typical"
    )
    assert {lane.level for lane in built.network.lanes} == {0, 1}
    assert standing_on_lanes(scene.mesh, built.network) == []
