"""Motions as bodies could do them: by the tables alone, with nothing of what made them."""

from collections.abc import Callable, Iterator

import numpy as np
import pandas as pd
import pytest
import shapely

from urbantwin.taxonomy import semantic_id
from urbantwin.traffic import Motion
from urbantwin.twin import Twin

from ..thorough import further

#: Changes are looked at over this time, seconds.
OVER_S = 0.5
#: How hard each class speeds up and brakes at the most (m/s2), its greatest acceleration to the
#: side (m/s2) and rate of turning (rad/s). Cars: AASHTO, Geometric Design of Highways and
#: Streets, 2018, 2.2 and 3.2 (braking 8 on dry roads); heavy vehicles: UN Regulation 13;
#: two-wheelers: Wilson, Bicycling Science, 2004, chapter 7; trams: BOStrab, emergency brake;
#: people: from standing to walking within half a second (Highway Capacity Manual 2010, chapter 4).
LIMITS = {
    "car": (4.0, 8.0, 4.5, 1.3),
    "van": (4.0, 8.0, 4.5, 1.3),
    "truck": (2.2, 6.5, 4.5, 1.0),
    "bus": (2.2, 6.5, 4.5, 1.0),
    "motorcycle": (5.5, 8.0, 4.5, 1.8),
    "bicycle": (2.2, 5.5, 4.5, 2.2),
    "tram": (1.8, 3.0, 3.0, 0.5),
    "pedestrian": (5.0, 5.0, np.inf, np.inf),
}
WALKED = ("sidewalk", "crossing", "walkingarea")
SOLID = ("building", "fence", "pole", "trunk")
#: Boxes may share so much in plan, m2; a wheel may be so far from its ground, metres.
SHARED_M2, OFF_M = 0.05, 0.12
#: So far aside people walk of their lanes, and the middle of a bicycle rides, metres.
BESIDE_M = {"pedestrian": 1.6, "bicycle": 1.0}


def runs(actors: pd.DataFrame, step_s: float) -> Iterator[tuple[str, pd.DataFrame]]:
    """Each actor as long as it is there without a gap, and its class."""
    for _, rows in actors.sort_values(["track", "time_s"]).groupby("track"):
        gaps = np.flatnonzero(np.diff(rows.time_s) > 1.5 * step_s) + 1
        for part in np.split(np.arange(len(rows)), gaps):
            if len(part) * step_s > 3 * OVER_S:
                yield rows["class"].iloc[0], rows.iloc[part]


def changes(rows: pd.DataFrame, step_s: float) -> tuple[float, float, float, float]:
    """The strongest start and braking, acceleration to the side, and rate of turning."""
    over = round(OVER_S / step_s)
    yaw = np.unwrap(rows.yaw)
    moved = np.diff(rows[["x", "y"]].to_numpy(), axis=0)
    middle = (yaw[1:] + yaw[:-1]) / 2
    ahead = (moved * np.column_stack([np.cos(middle), np.sin(middle)])).sum(axis=1) / step_s
    speed = np.convolve(ahead, np.full(over, 1 / over), "valid")
    gained = (speed[over:] - speed[:-over]) / (over * step_s)
    turned = (yaw[over:] - yaw[:-over]) / (over * step_s)
    sideways = np.abs(turned * speed[: len(turned)])
    return gained.max(initial=0), -gained.min(initial=0), sideways.max(), np.abs(turned).max()


def boxes(rows: pd.DataFrame) -> np.ndarray:
    """The outlines of boxes in plan (N,)."""
    turned = np.exp(1j * rows.yaw.to_numpy())[:, None] / 2
    sides = np.array([1 + 1j, 1 - 1j, -1 - 1j, -1 + 1j])
    length, width = (rows[name].to_numpy()[:, None] for name in ("length", "width"))
    corners = (sides.real * length + 1j * sides.imag * width) * turned
    corners += (rows.x + 1j * rows.y).to_numpy()[:, None]
    return shapely.polygons(np.stack([corners.real, corners.imag], axis=-1))


def overlapping(actors: pd.DataFrame) -> set[tuple[int, int]]:
    """The pairs of tracks whose boxes overlap at any step, but of bodies that hang together."""
    found: set[tuple[int, int]] = set()
    for _, rows in actors.groupby("time_s"):
        shapes, z, track = boxes(rows), rows.z.to_numpy(), rows.track.to_numpy()
        one, other = shapely.STRtree(shapes).query(shapes, predicate="intersects")
        met = (one < other) & (np.abs(z[one] - z[other]) < 2.0)
        one, other = one[met], other[met]
        deep = shapely.area(shapely.intersection(shapes[one], shapes[other])) > SHARED_M2
        found |= set(zip(track[one[deep]].tolist(), track[other[deep]].tolist(), strict=True))
    return {pair for pair in found if not hang_together(actors, *pair)}


def hang_together(actors: pd.DataFrame, one: int, other: int) -> bool:
    """Whether two tracks are bodies of one vehicle: they move, and their middles stay as far."""
    first, second = (actors[actors.track == x].set_index("time_s") for x in (one, other))
    bodies = {first["class"].iloc[0], second["class"].iloc[0]}
    if not bodies & {"trailer", "tram", "bus"}:
        return False
    both = first.index.intersection(second.index)
    place, theirs = (x.loc[both, ["x", "y"]].to_numpy() for x in (first, second))
    apart = np.hypot(*(place - theirs).T)
    return bool(np.ptp(apart) < 0.5 and np.ptp(place, axis=0).max() > 1.0)


def triangles(twin: Twin, names: tuple[str, ...]) -> np.ndarray:
    """The corners (F, 3, 3) of the triangles of some classes."""
    mesh = twin.mesh
    faces = np.isin(mesh.semantic, [semantic_id(name) for name in names])
    return mesh.vertices[mesh.faces[faces]]


def through_walls(twin: Twin, actors: pd.DataFrame) -> set[int]:
    """The tracks whose middles come into what stands above their knees."""
    corners = triangles(twin, SOLID)
    low, high = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    plan = shapely.convex_hull(shapely.multipoints(corners[..., :2]))
    rows, shape = shapely.STRtree(plan).query(
        shapely.points(actors[["x", "y"]].to_numpy()), predicate="dwithin", distance=0.05
    )
    z, height = actors.z.to_numpy()[rows], actors.height.to_numpy()[rows]
    hit = (high[shape] > z + 0.6) & (low[shape] < z + 0.8 * height)
    return set(actors.track.to_numpy()[rows[hit]].tolist())


def off_the_ground(twin: Twin, actors: pd.DataFrame) -> pd.DataFrame:
    """The rows whose middle is not where the ground is, of those above ground of one height."""
    ground = twin.ground_mesh
    corners = ground.vertices[ground.faces]
    level = np.abs(np.cross(*np.moveaxis(np.diff(corners, axis=1), 1, 0))[:, 2]) > 1e-6
    corners = corners[level]
    points = actors[["x", "y"]].to_numpy()
    row, face = shapely.STRtree(shapely.polygons(corners[..., :2])).query(
        shapely.points(points), predicate="intersects"
    )
    a, b, c = np.moveaxis(corners[face], 1, 0)
    normal = np.cross(b - a, c - a)
    rises = (normal[:, :2] * (points[row] - a[:, :2])).sum(axis=1) / normal[:, 2]
    away = np.abs(a[:, 2] - rises - actors.z.to_numpy()[row])
    nearest = pd.Series(away).groupby(row).min()
    known = actors.iloc[nearest.index]
    return known[nearest.to_numpy() > OFF_M]


def on_their_lanes(twin: Twin, actors: pd.DataFrame, name: str) -> float:
    """The share of the rows of a class that are where it walks or rides."""
    lanes = [
        lane.polygon
        for lane in twin.roads.lanes
        if (lane.kind in WALKED if name == "pedestrian" else name in lane.allowed)
    ]
    area = shapely.union_all(lanes).buffer(BESIDE_M[name])
    rows = actors[actors["class"] == name]
    inside = shapely.contains_xy(area, rows.x.to_numpy(), rows.y.to_numpy())
    return float(np.mean(inside)) if len(rows) else 1.0


PLACES = ["crossing", "two-avenues", *further("manchester-kingsway"), *further("munich")]


@pytest.fixture(scope="module", params=PLACES)
def driven(
    request: pytest.FixtureRequest, real_drive: Callable[[str], tuple[Twin, Motion]]
) -> tuple[Twin, Motion, pd.DataFrame]:
    twin, motion = real_drive(request.param)
    return twin, motion, motion.actors.to_pandas()


def test_actors_speed_up_brake_and_turn_as_their_classes_can(
    driven: tuple[Twin, Motion, pd.DataFrame],
) -> None:
    _, motion, actors = driven
    over: list[tuple[str, int, list[float]]] = []
    count = 0
    for name, rows in runs(actors, motion.step_s):
        if name in LIMITS:
            count += 1
            found = changes(rows, motion.step_s)
            if (np.array(found) > LIMITS[name]).any():
                over.append((name, int(rows.track.iloc[0]), [round(x, 1) for x in found]))
    assert count > 20
    assert over == []


def test_no_two_boxes_overlap(driven: tuple[Twin, Motion, pd.DataFrame]) -> None:
    assert overlapping(driven[2]) == set()


def test_nobody_passes_through_walls(driven: tuple[Twin, Motion, pd.DataFrame]) -> None:
    assert through_walls(driven[0], driven[2]) == set()


def test_wheels_and_feet_are_on_the_ground(driven: tuple[Twin, Motion, pd.DataFrame]) -> None:
    twin, _, actors = driven
    some = actors.iloc[::17]
    assert len(off_the_ground(twin, some)) <= 0.002 * len(some)


@pytest.mark.parametrize("name", ["pedestrian", "bicycle"])
def test_people_and_bicycles_keep_to_their_lanes_and_crossings(
    driven: tuple[Twin, Motion, pd.DataFrame], name: str
) -> None:
    twin, _, actors = driven
    assert on_their_lanes(twin, actors, name) > 0.98
