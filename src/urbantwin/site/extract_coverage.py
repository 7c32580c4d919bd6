"""Area in which an extract is complete: the downloaded area, without ways that extend beyond."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import Geod
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.extract import Extract

__all__ = ["check_roads", "clusters", "local_frame", "mapped_area", "small_features"]

#: Largest extent of a small feature, metres; larger ways may be included because of one end only.
SMALL_M = 60.0
#: Small features farther apart than this belong to different downloads, metres.
_GAP_M = 120.0
#: Margin of the area beyond the outermost small feature, metres.
_RIM_M = 10.0


def local_frame(extract: Extract) -> SiteFrame:
    """Return a frame in the middle of an extract's data, for use before an anchor is known."""
    used = [node for way in extract.highways() for node in way.nodes if node in extract.nodes]
    lonlat = np.array([extract.nodes[node] for node in used or extract.nodes])
    longitude, latitude = np.median(lonlat, axis=0)
    return SiteFrame(round(float(latitude), 6), round(float(longitude), 6))


def clusters(points: NDArray[np.float64], gap_m: float) -> NDArray[np.int64]:
    """Return cluster numbers (N,) of points; points at most ``gap_m`` apart share one."""
    pairs = cKDTree(points).query_pairs(gap_m, output_type="ndarray")
    shape = (len(points), len(points))
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=shape)
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def small_features(extract: Extract, frame: SiteFrame) -> NDArray[np.float64]:
    """Return positions (N, 2) of features too small to reach beyond the downloaded area.

    Downloads keep ways whole, so a long way says little about the border of a download. Tagged
    nodes without ways, and small ways, are either inside or missing.
    """
    in_ways = {node for way in extract.ways.values() for node in way.nodes}
    found = [
        extract.nodes[node] for node in sorted(extract.node_tags.keys() - in_ways)
        if not extract.node_tags[node].keys() & {"place", "boundary"}
    ]  # fmt: skip
    lonlat = np.array(found, dtype=np.float64).reshape(-1, 2)
    middles = []
    for _, way in sorted(extract.ways.items()):
        nodes = np.array([extract.nodes[node] for node in way.nodes if node in extract.nodes])
        if len(nodes) >= 2 and way.tags:
            low, high = nodes.min(axis=0), nodes.max(axis=0)
            scale = 111_320.0 * np.array([np.cos(np.radians(low[1])), 1.0])
            if np.linalg.norm((high - low) * scale) <= SMALL_M:
                middles.append((low + high) / 2)
    lonlat = np.vstack([lonlat, np.array(middles).reshape(-1, 2)])
    near = np.abs(lonlat - [frame.longitude, frame.latitude]).max(axis=1) < 1.0
    return frame.site_from_lonlat(lonlat[near])


def mapped_area(extract: Extract, frame: SiteFrame) -> shapely.Polygon:
    """Return the area, site frame, in which an extract is presumably complete.

    It is the declared bounds of the file, or else the convex hull of the largest cluster of small
    features (see `small_features`), or else that of the nodes of its roads.
    """
    roads = [node for way in extract.highways() for node in way.nodes if node in extract.nodes]
    lonlat = np.array([extract.nodes[node] for node in roads or extract.nodes])
    if extract.bounds:
        west, south, east, north = extract.bounds
        inside = ((lonlat >= [west, south]) & (lonlat <= [east, north])).all(axis=1)
        if inside.any() and east - west < 1.0 and north - south < 1.0:
            corners = [[west, south], [east, south], [east, north], [west, north]]
            return shapely.Polygon(frame.site_from_lonlat(corners))
    places = small_features(extract, frame)
    if len(places) >= 5:
        numbers = clusters(places, _GAP_M)
        places = places[numbers == np.argmax(np.bincount(numbers))]
    if len(places) < 5:
        near = np.abs(lonlat - [frame.longitude, frame.latitude]).max(axis=1) < 1.0
        places = frame.site_from_lonlat(lonlat[near])
    return shapely.MultiPoint(places).convex_hull.buffer(_RIM_M, quad_segs=4)


def check_roads(extract: Extract, frame: SiteFrame, region: shapely.Polygon, named: str) -> None:
    """Check that an extract has roads in a region, which errors call ``named``.

    Raises:
        InputError: no roads at all, or none in the region; states the distance of the nearest.
    """
    highways = extract.highways()
    expected = f"an extract around {frame.latitude:.6f}, {frame.longitude:.6f}"
    if not highways and not extract.is_whole:
        raise InputError(f"has no road near {named}", file=extract.path, expected=expected)
    if not highways:
        raise InputError("holds no roads", file=extract.path, expected="ways with a highway tag")
    lonlat = [np.array([extract.nodes[n] for n in way.nodes if n in extract.nodes])
              for way in highways]  # fmt: skip
    lonlat = [points for points in lonlat if len(points) >= 2]
    anchor = np.array([frame.longitude, frame.latitude])
    # Within one degree the projection's formulas surely hold.
    near = [points for points in lonlat if np.abs(points - anchor).max() < 1.0]
    lines = [shapely.LineString(frame.site_from_lonlat(points)) for points in near]
    if lines:
        nearest_m = float(shapely.distance(np.array(lines), region).min())
    elif lonlat:
        nodes = np.vstack(lonlat)
        away_m = Geod(ellps="WGS84").inv(*nodes.T, *np.broadcast_to(anchor, nodes.shape).T)[2]
        nearest_m = float(np.min(away_m))
    else:
        raise InputError("holds no roads", file=extract.path, expected="ways with their nodes")
    if nearest_m == 0.0:
        return
    away = f"{nearest_m / 1000:.1f} km" if nearest_m >= 1000 else f"{nearest_m:.0f} m"
    raise InputError(
        f"has no road within {named}: the nearest is {away} away from it",
        file=extract.path,
        expected=expected,
    )
