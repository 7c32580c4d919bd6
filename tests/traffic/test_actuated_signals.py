"""Actuated signals: SUMO's own controller shows what is recorded, and is found again."""

from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from lxml import etree

from urbantwin.geometry import SiteFrame
from urbantwin.roads.signals.programs import set_programs
from urbantwin.site.signals import SignalPlan, SignalSpec
from urbantwin.site.yaml_document import read_document
from urbantwin.traffic.assets import asset
from urbantwin.traffic.calibration.actuated import actuated_cycle
from urbantwin.traffic.calibration.passages import JunctionLinks, SeenTrack, passages_of
from urbantwin.traffic.calibration.signal_timing import Timing, timing_of
from urbantwin.traffic.calibration.simulated import simulated_tracks
from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.traffic.recorded.track import RecordedSignals
from urbantwin.traffic.sumo.simulation import simulate
from urbantwin.twin import Twin

pytestmark = pytest.mark.thorough

STEP_S, SECONDS, FIT_S = 0.1, 600.0, 400.0
#: How long greens of the truth last at the least and at the most, seconds.
LEAST_S, MOST_S = 7.0, 31.0
Shown = dict[str, tuple[tuple[float, str], ...]]


def letters(greens: list[tuple[float, float]]) -> dict[str, np.ndarray]:
    """Return what two groups show whose greens last so long, cycle by cycle, every 0.1 s."""
    found: dict[str, str] = {"one": "", "other": ""}
    for one, other in greens:
        first, second = round(one / STEP_S), round(other / STEP_S)
        found["one"] += "G" * first + "y" * 30 + "r" * (20 + second + 50)
        found["other"] += "r" * (first + 50) + "G" * second + "y" * 30 + "r" * 20
    return {name: np.array(list(text)) for name, text in found.items()}


@pytest.mark.parametrize(
    "greens",
    [
        [(20.0, 30.0)] * 30,
        [(20.0, 30.0)] * 15 + [(15.0, 35.0)] * 15,  # another program at some time of day
        [(20.0 + 0.1 * (k % 3), 30.0) for k in range(30)],  # told to some tenths
    ],
)
def test_a_fixed_program_is_not_actuated(greens: list[tuple[float, float]]) -> None:
    assert actuated_cycle(letters(greens), STEP_S) is None


def test_greens_that_differ_again_and_again_are_extended() -> None:
    rng = np.random.default_rng(5)
    lasts = np.round(rng.uniform(6.0, 40.0, 30), 1)
    found = actuated_cycle(letters([(one, 25.0) for one in lasts]), STEP_S)
    assert found is not None
    assert found.driven
    assert found.groups == ("one", "other")
    extended = [k for k in range(6) if found.at_least[k] < found.at_most[k]]
    assert [found.letters[k] for k in extended] == [("G", "r")]
    # Where the first begins is not seen.
    assert found.at_least[extended[0]] == pytest.approx(lasts[1:].min(), abs=0.11)
    assert found.at_most[extended[0]] == pytest.approx(lasts[1:].max(), abs=0.11)
    assert sorted(found.seconds)[:4] == [2.0, 2.0, 3.0, 3.0]


def test_phases_in_many_orders_are_not_driven() -> None:
    rng = np.random.default_rng(6)
    both = [letters([tuple(rng.uniform(6.0, 40.0, 2))]) for _ in range(40)]
    turned = [
        {"one": one["other"], "other": one["one"]} if k % 3 else one for k, one in enumerate(both)
    ]
    whole = {name: np.concatenate([one[name] for one in turned]) for name in ("one", "other")}
    found = actuated_cycle(whole, STEP_S)
    assert found is None or not found.driven


@pytest.fixture(scope="module")
def actuated_twin(
    crossing_net: Path, twin_of: Callable[..., Twin], tmp_path_factory: pytest.TempPathFactory
) -> Twin:
    """The crossing with SUMO's own actuated controller."""
    folder = tmp_path_factory.mktemp("actuated")
    tree = etree.parse(crossing_net)
    (logic,) = tree.getroot().iter("tlLogic")
    logic.set("type", "actuated")
    for phase in logic.iter("phase"):
        if "G" in phase.get("state") and "y" not in phase.get("state"):
            phase.set("minDur", f"{LEAST_S:g}")
            phase.set("maxDur", f"{MOST_S:g}")
    net = folder / "actuated.net.xml"
    tree.write(str(net))
    per_hour = {"car": 900.0, "van": 100.0}
    return twin_of(folder / "twin", net, per_hour)


def shown_by(twin: Twin, net: Path, seed: int) -> Shown:
    """Return what each link showed while a twin's traffic drove on a network."""
    demand = demand_of(twin, duration_s=SECONDS, seed=seed)
    found = simulate(
        net, demand, asset, warmup_s=60.0, steps=round(SECONDS / STEP_S), step_s=STEP_S, seed=seed
    )
    changes: dict[str, list[tuple[float, str]]] = defaultdict(list)
    for step, _, state in found.signals:
        for link, letter in enumerate(state):
            before = changes[f"group {link}"]
            if not before or before[-1][1] != letter:
                before.append((round(step * STEP_S, 1), letter))
    return {group: tuple(rows) for group, rows in changes.items()}


@pytest.fixture(scope="module")
def shown(actuated_twin: Twin) -> Shown:
    return shown_by(actuated_twin, actuated_twin.net_path, 1)


@pytest.fixture(scope="module")
def timing(actuated_twin: Twin, shown: Shown, tmp_path_factory: pytest.TempPathFactory) -> Timing:
    """What the first part of it tells."""
    twin = actuated_twin
    tracks: list[SeenTrack] = simulated_tracks(
        twin,
        {**twin.site["traffic"], "warmup_s": 60.0},
        SECONDS,
        shapely.box(-140, -140, 140, 140),
        scratch=tmp_path_factory.mktemp("sumo"),
        told=lambda _: None,
    )
    links = JunctionLinks.of(twin.net_path, twin.roads)
    found = timing_of(RecordedSignals(shown), passages_of(tracks, twin.roads, links), links, FIT_S)
    assert found is not None
    return found


def greens(shown: Mapping[str, tuple[tuple[float, str], ...]], group: str) -> np.ndarray:
    """Return when the greens of a group begin and how long they last (K, 2), seconds."""
    found, since = [], np.nan
    for (_, was), (at, letter) in zip(shown[group], shown[group][1:], strict=False):
        if letter in "Gg" and was not in "Gg":
            since = at
        elif letter not in "Gg" and was in "Gg" and np.isfinite(since):
            found.append((since, at - since))
    return np.array(found)


def test_limits_are_those_that_were_shown(timing: Timing) -> None:
    assert timing.actuated is not None
    assert timing.actuated.driven
    extended = [
        (least, most)
        for least, most in zip(timing.actuated.at_least, timing.actuated.at_most, strict=True)
        if least < most
    ]
    assert extended
    for least, most in extended:
        assert LEAST_S - 0.11 <= least < most <= MOST_S + 0.11


def test_what_is_calibrated_shows_greens_as_long_as_those_held_out(
    actuated_twin: Twin, timing: Timing, shown: Shown, tmp_path: Path
) -> None:
    written = tmp_path / "site.yaml"
    signal = {"junction": "c", "minimum_green": 0.0, "states": timing.program}
    written.write_text(yaml.safe_dump({"signals": [signal]}))
    read = read_document(written, kind="a site")
    plan = SignalPlan(SignalSpec.model_validate(read.value["signals"][0]), read, 0)
    net = tmp_path / "fitted.net.xml"
    net.write_bytes(actuated_twin.net_path.read_bytes())
    set_programs(net, [plan], SiteFrame(50.0, 8.0))
    again = shown_by(actuated_twin, net, 2)
    judged = 0
    for link, group in timing.group_of.items():
        recorded, simulated = greens(shown, group), greens(again, f"group {link}")
        held_out = recorded[recorded[:, 0] > FIT_S, 1]
        assert len(simulated) > 0.8 * len(recorded)
        assert simulated[:, 1].std() > 1.0
        assert simulated[:, 1].mean() == pytest.approx(held_out.mean(), rel=0.25), group
        judged += 1
    assert judged >= 4
