"""A twin of Pittsburgh beside what two VLP-32C really saw there, within 25 m."""

import pytest

from ..real_cases.pittsburgh_case import measure

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def figures(shared_data):
    return measure(shared_data / "lidar" / "argoverse2-pittsburgh")


def test_the_road_of_the_map_is_within_the_targets(figures):
    road = figures["road", "twin"]
    assert min(road["points"], road["real_points"]) > 7_000
    assert road["p95_m"] < 1.0
    assert road["js"] < 0.15
    assert road["p2m_m"] < 0.10


def test_actors_as_annotated_are_where_they_are_and_as_bright(figures):
    actors = figures["actors", "twin"]
    assert min(actors["points"], actors["real_points"]) > 7_000
    assert actors["js"] < 0.15
    # Boxes are beside the cars in them, and in one there is none: not within 10 cm.
    assert actors["p95_m"] < 2.0
    assert actors["p2m_median_m"] < 0.5


@pytest.mark.parametrize("part", ["road", "actors"])
def test_what_the_map_gives_is_no_nearer_than_the_real_sweep_a_turn_later(figures, part):
    twin, again = figures[part, "twin"], figures[part, "real"]
    for name in ("p95_m", "js", "p2m_m"):
        assert 0 < again[name] < twin[name]
