"""Proposed sensors of real places, judged in plan by the map itself."""

from pathlib import Path

import numpy as np
import pytest
import shapely

import urbantwin as ut
from urbantwin.site import load_site, read_extract

from ..thorough import further

STREETS = ("primary", "secondary", "tertiary", "trunk", "residential", "unclassified")


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name", ["West-Oakland.osm.bz2", *further("taipei.osm", "neukolln.osm", "london-borough.osm")]
)
def test_real_proposal_is_clear_and_sees_most_of_the_streets(
    shared_data: Path, tmp_path: Path, name: str
) -> None:
    """Buildings count as endlessly high, streets as their middle lines."""
    source = shared_data / "osm" / name
    site = load_site(ut.init(tmp_path / "site", osm=source, progress=False).path)
    one = site.rig.sensors[0]
    pole = shapely.Point(one.east_m, one.north_m)
    assert 5.0 <= one.height_m <= 8.0
    features = read_extract(source).features(site.frame, shapely.Point(0, 0).buffer(60.0))
    built = shapely.union_all([x.geometry for x in features if "building" in x.tags])
    trees = [x.geometry for x in features if x.tags.get("natural") == "tree"]
    assert built.distance(pole) >= 3.0
    assert all(tree.distance(pole) >= 3.0 for tree in trees)
    disc = shapely.Point(0, 0).buffer(50.0)
    lines = [
        shapely.intersection(x.geometry, disc)
        for x in features
        if x.tags.get("highway") in STREETS and x.tags.get("tunnel", "no") == "no"
        if x.geometry.intersects(disc)
    ]
    assert min(shapely.distance(line, pole) for line in lines) >= 2.5
    along = [
        part.interpolate(s)
        for line in lines
        for part in shapely.get_parts(line)
        for s in np.arange(0.0, part.length, 3.0)
    ]
    sights = [shapely.LineString([pole, point]) for point in along]
    assert (~shapely.intersects(built, np.array(sights))).mean() >= 0.6
