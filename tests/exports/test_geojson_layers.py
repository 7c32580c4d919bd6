"""GeoJSON, read by GDAL as QGIS reads it."""

import json

import numpy as np
import pyogrio.raw
import pytest
import shapely
from pyproj import Transformer

from urbantwin.errors import InputError
from urbantwin.exports import export_twin
from urbantwin.exports.geojson import LAYERS

from ..thorough import further

KINDS = {
    **{key: {"Polygon", "MultiPolygon"} for key in ("lane", "junction", "crossing", "island")},
    **{key: {"LineString"} for key in ("centre_line", "stop_line")},
    **{key: {"Point"} for key in ("signal", "sign")},
}


@pytest.fixture(scope="module", params=["two_avenues_twin", *further("perth_twin")])
def layers(request, tmp_path_factory):
    """A twin, and its layers as GDAL reads them: geometries, fields, in site metres."""
    twin = request.getfixturevalue(request.param)
    folder = tmp_path_factory.mktemp("geojson") / "layers"
    export_twin(twin, "geojson", folder)
    back = Transformer.from_crs("EPSG:4326", twin.frame.proj, always_xy=True)

    def metres(lonlat):
        return np.column_stack(back.transform(lonlat[:, 0], lonlat[:, 1]))

    found = {}
    for name in LAYERS:
        meta, _, shapes, fields = pyogrio.raw.read(folder / f"{name}.geojson")
        rows = dict(zip(meta["fields"], fields, strict=True))
        assert meta["crs"] in (None, "EPSG:4326") if not len(shapes) else meta["crs"] == "EPSG:4326"
        found[name] = shapely.transform(shapely.from_wkb(shapes), metres), rows
    return twin, folder, found


def test_each_layer_has_one_kind_of_geometry(layers):
    _, _, found = layers
    for name, (shapes, _) in found.items():
        assert {shape.geom_type for shape in shapes} <= KINDS[name], name
        assert shapely.is_valid(shapes).all(), name


def test_lanes_are_where_the_twin_has_them(layers):
    twin, _, found = layers
    network = twin.roads
    shapes, rows = found["lane"]
    for shape, name in zip(shapes, rows["id"], strict=True):
        lane = network.lane_by_id[name]
        assert shapely.hausdorff_distance(shape, lane.polygon) < 0.02
    lines, rows = found["centre_line"]
    for line, name in zip(lines, rows["id"], strict=True):
        centre = network.lane_by_id[name].centre[:, :2]
        assert np.abs(shapely.get_coordinates(line) - centre).max() < 0.005
    assert len(found["crossing"][0]) == sum(lane.kind == "crossing" for lane in network.lanes)
    heads = [one for one in twin.lane_model.signals if one.dynamic]
    assert len(found["signal"][0]) == len(heads) > 0
    assert set(found["signal"][1]["program"]) == {program.id for program in network.programs}


def test_stop_lines_lie_across_the_ends_of_lanes(layers):
    twin, _, found = layers
    lines, rows = found["stop_line"]
    assert len(lines) > 0
    for line, name in zip(lines, rows["lane"], strict=True):
        if not name:
            continue
        lane = twin.roads.lane_by_id[name]
        ends = shapely.get_coordinates(line)
        across = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        along = lane.centre[-1, :2] - lane.centre[-2, :2]
        assert abs(across @ along / np.linalg.norm(along)) < 0.1
        assert line.distance(shapely.Point(lane.centre[-1, :2])) < 3.0


def test_turns_lead_where_they_say(layers):
    twin, _, found = layers
    _, rows = found["lane"]
    network = twin.roads
    named = {
        name: turns.split() for name, turns in zip(rows["id"], rows["turns"], strict=True) if turns
    }
    assert {turn for turns in named.values() for turn in turns} >= {"left", "through", "right"}
    # Keeping to one's own side, one turns into the near street without crossing the middle.
    near = "right" if network.driving_side == "right" else "left"
    kerb = [road.lanes for road in network.roads]
    for lanes in kerb:
        driven = [name for name in lanes if network.lane_by_id[name].kind == "driving"]
        if len(driven) > 1 and all(name in named for name in driven):
            far = "left" if near == "right" else "right"
            if near in named[driven[-1]]:
                assert near in named[driven[0]]
            if far in named[driven[0]]:
                assert far in named[driven[-1]]


def test_the_rules_of_rfc_7946_hold(layers):
    _, folder, _ = layers
    for name in LAYERS:
        document = json.loads((folder / f"{name}.geojson").read_text())
        assert "crs" not in document  # 4: always WGS84
        for feature in document["features"]:
            assert feature["properties"]["layer"] == name
            shape = shapely.geometry.shape(feature["geometry"])
            for part in shapely.get_parts(shape):
                if part.geom_type == "Polygon":
                    assert part.exterior.is_ccw  # 3.1.6
                    assert not any(ring.is_ccw for ring in part.interiors)


def test_one_file_holds_every_layer(layers, tmp_path):
    twin, folder, found = layers
    export_twin(twin, "geojson", tmp_path / "all.geojson")
    features = json.loads((tmp_path / "all.geojson").read_text())["features"]
    for name in LAYERS:
        own = json.loads((folder / f"{name}.geojson").read_text())["features"]
        assert [one for one in features if one["properties"]["layer"] == name] == own
    assert len(features) == sum(len(shapes) for shapes, _ in found.values())


def test_a_file_in_the_way_of_a_folder_is_left_alone(layers, tmp_path):
    (tmp_path / "mine").write_text("mine")
    with pytest.raises(InputError, match="is a file; expected a folder"):
        export_twin(layers[0], "geojson", tmp_path / "mine")
    assert (tmp_path / "mine").read_text() == "mine"
