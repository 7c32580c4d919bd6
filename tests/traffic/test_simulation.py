"""SUMO in its own process: what it is told, and what happens when it fails."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from urbantwin.errors import InputError, StageError
from urbantwin.roads import sumo_binary
from urbantwin.traffic.assets import asset, asset_names
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.sumo.simulation import simulate

from ..thorough import further

ONE_CAR = Demand((Trip("car", asset_names("car")[0], 0.0, ("wc", "ce")),), ())


def run(net: Path, demand: Demand = ONE_CAR, *, step_s: float = 0.1, steps: int = 50):
    return simulate(net, demand, asset, warmup_s=1.0, steps=steps, step_s=step_s, seed=1)


def test_sumos_first_error_is_passed_on(
    crossing_net: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    demand = Demand((Trip("car", asset_names("car")[0], 0.0, ("wc", "nowhere")),), ())
    with pytest.raises(StageError, match="nowhere") as caught:
        run(crossing_net, demand)
    assert "\n" not in str(caught.value)
    assert "Traceback" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_a_network_that_sumo_cannot_read_is_told(tmp_path: Path) -> None:
    broken = tmp_path / "broken.net.xml"
    broken.write_text("<net>")
    with pytest.raises(StageError, match="SUMO failed"):
        run(broken)


@pytest.mark.parametrize("step_s", [0.0333, 0.0, 0.0004])
def test_a_step_that_sumo_cannot_make_is_refused(crossing_net: Path, step_s: float) -> None:
    with pytest.raises(InputError, match="step_s"):
        run(crossing_net, step_s=step_s)


@pytest.mark.parametrize("step_s", [0.1, 1.0, *further(0.05, 0.25)])
def test_steps_of_any_length_see_the_same_distance(crossing_net: Path, step_s: float) -> None:
    seen = run(crossing_net, step_s=step_s, steps=round(5 / step_s))
    x = dict(zip(seen.step.tolist(), seen.front[:, 0], strict=True))
    # A car that entered at full speed drives on at about the limit of 13.9 m/s (0.7 to 1.2 of it).
    assert 4 * 0.7 * 13.9 < x[round(4 / step_s)] - x[0] < 4 * 1.2 * 13.9
    assert min(x) <= 0
    assert max(x) >= round(5 / step_s)


def test_positions_are_those_of_sumos_own_output(crossing_net: Path, tmp_path: Path) -> None:
    """Against the program ``sumo``, run on the same road with the simplest demand."""
    name = asset_names("car")[0]
    size = asset(name)
    routes = tmp_path / "one.rou.xml"
    routes.write_text(
        f'<routes><vType id="t" length="{size.length}" width="{size.width}" sigma="0" '
        'speedFactor="1"/><vehicle id="0" type="t" depart="0" departSpeed="max" departPos="base">'
        '<route edges="wc ce"/></vehicle></routes>'
    )
    fcd = tmp_path / "fcd.xml"
    command = [sumo_binary("sumo"), "-n", crossing_net, "-r", routes, "--fcd-output", fcd]
    command += ["--step-length", "0.1", "--end", "2", "--no-step-log", "true"]
    done = subprocess.run([str(part) for part in command], capture_output=True, check=False)
    assert done.returncode == 0
    first = fcd.read_text().split("<vehicle ")[1]
    expected = {key: float(first.split(f' {key}="')[1].split('"')[0]) for key in ("y", "angle")}
    seen = run(crossing_net)
    start = seen.step.argmin()
    # Lanes are drawn side by side: the same angle, and one lane's width apart at most.
    assert seen.angle_deg[start] == pytest.approx(expected["angle"], abs=0.5)
    assert abs(seen.front[start, 1] - expected["y"]) < 3.3
    assert np.isin(seen.lanes[seen.lane[start]], ["wc_1", "wc_2"])


def test_an_interrupt_ends_the_worker(crossing_net: Path) -> None:
    class StopError(Exception):
        pass

    def stop(fraction: float, _what: str) -> None:
        if fraction > 0.3:
            raise StopError

    with pytest.raises(StopError):
        simulate(
            crossing_net, ONE_CAR, asset, warmup_s=1.0, steps=50, step_s=0.1, seed=1, progress=stop
        )


def test_crashes_are_told(
    crossing_net: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    worker = tmp_path / "worker.py"
    worker.write_text("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    monkeypatch.setattr("urbantwin.traffic.sumo.simulation._WORKER", worker)
    with pytest.raises(StageError, match="SIGSEGV"):
        run(crossing_net)
