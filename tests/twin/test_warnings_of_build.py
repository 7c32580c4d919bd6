"""What a twin warns of."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from urbantwin.result_warning import ResultWarning
from urbantwin.roads import Lane, RoadNetwork, SignalHead
from urbantwin.twin.found_of_mapped import FoundOfMapped
from urbantwin.twin.result_warnings import warnings_of_build


def roads(
    *,
    left_out: list[dict[str, Any]] | None = None,
    stopped: tuple[str, ...] = (),
    shown: tuple[str, ...] = (),
    warnings: tuple[ResultWarning, ...] = (),
) -> Any:
    """What the roads of a build tell: lanes with signals, heads that stand, notes."""
    line, none = np.array([[0.0, 0, 0], [9, 0, 0]]), np.zeros((0, 2))
    lanes = tuple(Lane(x, x, "driving", 3.0, 9.0, line, none, 0, ("car",), (), "") for x in stopped)
    heads = tuple(SignalHead("p", (k,), x, 9.0, 0.0, 0.0) for k, x in enumerate(stopped))
    network = RoadNetwork("right", (), lanes, (), heads, ())
    standing = [SimpleNamespace(dynamic=True, strip=strips) for strips in shown]
    return SimpleNamespace(
        network=network,
        model=SimpleNamespace(signals=standing),
        notes={"left_out": left_out or []},
        warnings=warnings,
    )


def lines(
    made: Any,
    mapped: dict[str, FoundOfMapped] | None = None,
    *,
    scene: dict[str, Any] | None = None,
    known: float = 1.0,
    **sources: Any,
) -> list[str]:
    told = warnings_of_build(made, mapped or {}, sources, scene=scene or {}, known=known)
    return [str(one) for one in told]


def test_a_twin_with_all_that_is_mapped_has_no_warning() -> None:
    found = FoundOfMapped(20, 20, ())
    nearly = FoundOfMapped(39, 40, ((1.0, 2.0),))
    made = roads(stopped=("a", "b"), shown=("a b",))
    assert (
        lines(made, {"crossings": found, "signals": nearly}, survey={"placing": "as it is"}) == []
    )


def test_what_the_twin_lacks_of_the_map_is_told_with_a_place_to_look_at() -> None:
    lacking = FoundOfMapped(5, 11, ((-15.2, 63.4), (0.0, 0.0)))
    (line,) = lines(roads(), {"crossings": lacking})
    assert line.startswith("crossings: 5 of 11 mapped ones are in the twin")
    assert "15 m west, 63 m north of the anchor" in line


def test_parts_that_are_left_out_and_signals_that_stand_nowhere_are_told() -> None:
    parts = [
        {"roads": 2, "metres": 86.2, "names": "Swan Street"},
        {"roads": 1, "metres": 60.0, "names": "Hill Road"},
        {"roads": 1, "metres": 12.0, "names": "a stub"},
    ]
    streets = {"streets": FoundOfMapped(3, 5, ((1.0, 2.0), (3.0, 4.0)))}
    assert lines(roads(), streets)[0].startswith("streets: 3 of 5 mapped ones are in the twin")
    (line,) = lines(roads(left_out=parts), streets)  # told once, by their names
    assert line.startswith("roads: 146 m are left out (Swan Street, Hill Road)")
    (line,) = lines(roads(stopped=("a", "b", "c"), shown=("a",)))
    assert line.startswith("signals: 2 heads are missing")
    nowhere = {"signals": {"signals without a place beside the carriageway, left out": 3}}
    (line,) = lines(roads(stopped=("a", "b"), shown=("a",)), scene=nowhere)
    assert line.startswith("signals: 4 heads are missing")


def test_a_region_that_the_map_does_not_know_is_told() -> None:
    assert lines(roads(), known=0.92) == []
    (line,) = lines(roads(), known=0.63)
    assert line.startswith("map: 37% of the region lies beyond")


def test_problems_of_sources_and_of_the_roads_themselves_come_through() -> None:
    own = ResultWarning("junction", "has no way through")
    told = lines(roads(warnings=(own,)), survey={"problems": ["has no CRS", "is far off"]})
    assert told[0] == str(own)
    assert [line.split(";")[0] for line in told[1:]] == [
        "geometry survey: has no CRS",
        "geometry survey: is far off",
    ]


def test_tags_that_are_taken_otherwise_are_told_once() -> None:
    made = roads()
    made.notes["reinterpreted"] = [
        "way 3 at 52.50000, 13.40000: oneway:bicycle=no: bicycles ride with the traffic only",
        "way 3 at 52.50000, 13.40000: lanes=2, but lanes:forward=3: the parts are taken",
    ]
    made.notes["map"] = {"reinterpreted": ["relation 7 at 49.00000, 8.40000: one_way=no: used so"]}
    (line,) = lines(made)
    assert line.startswith("roads: tags of 2 of the map's elements are taken otherwise")
    assert "way 3 at 52.50000, 13.40000: oneway:bicycle=no" in line
    assert line.endswith("urbantwin info TWIN lists all")
