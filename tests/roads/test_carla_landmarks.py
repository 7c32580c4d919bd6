"""CARLA announces to each lane its own signals, and no other, on the way to the stop line."""

import pytest

from urbantwin.roads.opendrive import write_opendrive
from urbantwin.roads.opendrive.writing.write import as_right_hand_traffic

#: Signals beyond the junction and mph; left-hand traffic, signals before and beyond; the near side.
PLACES = ("quad_intersection", "perth_stretched_lights", "neukolln")


@pytest.fixture(scope="module")
def announced(real_roads, tmp_path_factory, judge):
    folder = tmp_path_factory.mktemp("landmarks")
    models, files = {}, []
    for name in PLACES:
        place = real_roads(name)
        files.append(folder / f"{name}.xodr")
        write_opendrive(place.built.model, place.frame, files[-1], version="1.4", name=name)
        models[name] = place.built.model
    answers = judge("carla_landmarks", *files)
    return {name: (models[name], answers[str(folder / f"{name}.xodr")]) for name in models}


@pytest.mark.parametrize("name", PLACES)
def test_every_signalised_lane_sees_its_signals_before_the_junction(name, announced):
    model, rows = announced[name]
    expected, seen = {}, {}
    turned = as_right_hand_traffic(model)
    stations = {signal.id: signal.s for signal in turned.signals}
    for signal in turned.signals:
        road = turned.road_by_id[signal.road]
        if signal.dynamic and signal.lanes and road.junction < 0:
            for lane in signal.lanes:
                expected.setdefault((signal.road, lane), set()).add(signal.id)
    for road, lane, s, marks in rows:
        for number, kind, distance, _ in marks:
            if kind == "1000001":
                seen.setdefault((road, lane), set()).add(number)
                end = turned.road_by_id[road].length if lane < 0 else 0.0
                assert abs(stations[number] - end) <= 8.0
                assert distance == pytest.approx(abs(stations[number] - s), abs=0.5)
    # CARLA has waypoints on lanes for cars only.
    driven = {(road, lane) for road, lane, _, _ in rows}
    assert len(expected.keys() & driven) >= 2
    assert seen == {lane: signals for lane, signals in expected.items() if lane in driven}


@pytest.mark.parametrize(("name", "limits"), [("quad_intersection", {32, 40, 48, 56, 80, 97})])
def test_limits_are_told_in_carlas_numbers(name, limits, announced):
    model, rows = announced[name]
    told = {m[3] for row in rows for m in row[3] if m[1] == "274"}
    assert told
    assert told <= limits  # 20, 25, 30, 35, 50 and 60 mph in km/h
    assert {s.unit for s in model.signals if not s.dynamic} == {"mph"}
