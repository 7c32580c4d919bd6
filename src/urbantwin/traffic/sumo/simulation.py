"""Running SUMO: its input files, its process and its output."""

from __future__ import annotations

import json
import math
import re
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact import passing_folder
from urbantwin.errors import InputError, StageError
from urbantwin.roads import RoadNetwork
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.demand.passengers import boarding_job
from urbantwin.traffic.demand.vehicle_types import IN_QUEUES
from urbantwin.traffic.sumo.halts import write_stops
from urbantwin.traffic.sumo.observed import Observed
from urbantwin.traffic.sumo.route_file import write_routes
from urbantwin.traffic.sumo.row_columns import row_columns
from urbantwin.traffic.sumo.tram_conflicts import tram_conflicts
from urbantwin.traffic.sumo.worker_input import curves_of, gates_of, one_lane_streets

__all__ = [
    "STUCK_S",
    "Simulated",
    "observe",
    "simulate",
    "sumo_options",
    "sumo_substeps",
    "with_rows",
    "write_stops",
]

_WORKER = Path(__file__).with_name("worker.py")
_LARGEST_STEP_MS = 100  # SUMO's car following and sublane movement are smooth at this step
MARGIN_S = 3.0  # recorded before the first and after the last step, for headings
#: Halt after which SUMO removes a vehicle, seconds: longer than any red, so it is in a deadlock.
_TELEPORT_S = 180
_JUNCTION_BLOCKER_S = 60
_PEDESTRIAN_SQUEEZE_S = 120  # pedestrians that block each other for longer squeeze past
STUCK_S = 300.0  # longer halts of circulating actors are reported
_SUBLANE_M = 0.8  # two-wheelers pass each other and cars within a lane


#: Columns of `Simulated` with one value per row.
ROWS = ("step", "trip", "front", "angle_deg", "speed", "lane")


@dataclass(frozen=True, eq=False)
class Simulated:
    """SUMO's output, one row per actor and step, in SUMO's conventions.

    Attributes:
        step: (N,) step of the motion; includes ``MARGIN_S`` before and after it.
        trip: (N,) index of the demand's trip.
        front: (N, 2) middle of the front bumper, site frame, m.
        angle_deg: (N,) heading, clockwise from north.
        speed: (N,) m/s.
        lane: (N,) index into ``lanes``.
        lanes: ids of lanes.
        signals: (step, program, state of every link) at each change of a program's state.
        teleports: number of vehicles that SUMO removed because they were stuck.
        collisions: number of pairs of actors that SUMO reported as overlapping.
        collided: for each of these pairs its first time (seconds of the motion), x and y, the lane,
            and the numbers of the two trips; by time.
        departed: trips that entered the network.
        sumo: SUMO's version.
        observed: statistics of each second, warm-up included.
        staged: outcome of each staged event (``staging.Staging.told``).
        boarded: events of passengers: seconds of the motion, ``waits``, ``boards`` or ``alights``,
            trip, stop, the vehicle's trip, and rank among the passengers of the halt.
    """

    step: NDArray[np.int32]
    trip: NDArray[np.int32]
    front: NDArray[np.float64]
    angle_deg: NDArray[np.float64]
    speed: NDArray[np.float64]
    lane: NDArray[np.int32]
    lanes: tuple[str, ...]
    signals: tuple[tuple[int, str, str], ...]
    teleports: int
    collisions: int
    departed: frozenset[int]
    sumo: str
    observed: Observed
    staged: tuple[dict[str, Any], ...] = ()
    boarded: tuple[tuple[float, str, int, int, int, int], ...] = ()
    collided: tuple[tuple[float, float, float, str, str, str], ...] = ()

    def only(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Simulated:
        """Return the output with some of the rows: a mask (N,) or indices."""
        rows: dict[str, Any] = {name: getattr(self, name)[chosen] for name in ROWS}
        return replace(self, **rows)

    def by_trip(self) -> NDArray[np.int64]:
        """Return the order of the rows by trip and step."""
        return np.asarray(np.lexsort([self.step, self.trip]))

    def of_trip(self, trip: int, by_trip: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the rows of a trip, by step.

        Args:
            trip: its number.
            by_trip: result of `by_trip`.
        """
        ends = np.array([trip, trip + 1], self.trip.dtype)  # another type would copy the column
        return by_trip[slice(*np.searchsorted(self.trip, ends, sorter=by_trip))]


def with_rows(
    whole: list[Simulated], more: Sequence[Mapping[str, NDArray[np.generic]]]
) -> Simulated:
    """Return the output in a list, which is removed from it, with the rows of ``more`` appended.

    Without other references, at most one column is in memory twice, which saves a hundred megabytes
    for an hour of traffic.

    Args:
        whole: list of one output.
        more: further rows, by the names of `ROWS`.
    """
    output = whole.pop()
    rows: dict[str, Any] = {name: getattr(output, name) for name in ROWS}
    output = output.only(np.zeros(0, np.int64))
    for name in ROWS:
        rows[name] = np.concatenate([rows[name], *(part[name] for part in more)])
    return replace(output, **rows)


def simulate(  # noqa: PLR0913 - all inputs of SUMO
    net_path: Path,
    demand: Demand,
    asset: Callable[[str], Asset],
    *,
    warmup_s: float,
    steps: int,
    step_s: float,
    seed: int,
    staged: Sequence[Mapping[str, Any]] = (),
    roads: RoadNetwork | None = None,
    scratch: Path | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Simulated:
    """Run the demand through SUMO in a separate process.

    Args:
        net_path: the SUMO network.
        demand: the trips.
        asset: returns the mesh of a name, with its length, width and height.
        warmup_s: duration simulated before the first recorded step.
        steps: number of recorded steps.
        step_s: time between steps, seconds; SUMO's own step is at most 0.1 s and divides it.
        seed: SUMO's seed.
        staged: events that others react to, in the form of ``staging``.
        roads: the lanes, for conflicts of trams with other traffic.
        scratch: folder for SUMO's files; ``None``: the system's.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: the step is not a whole number of milliseconds, SUMO's resolution of time.
        StageError: SUMO failed; the message holds SUMO's first error.
    """
    step_ms, substeps = sumo_substeps(step_s)
    warmup_steps = math.ceil(warmup_s * 1000 / step_ms)
    margin = math.ceil(MARGIN_S * 1000 / step_ms)
    options = sumo_options(step_ms // substeps, seed, circulates=demand.circulates)
    job = {
        "warmup_substeps": warmup_steps * substeps,
        "first_step": -min(margin, warmup_steps),
        "last_step": steps - 1 + margin,
        "substeps": substeps,
        "staged": list(staged),
        "gates_until_s": warmup_s,
    }
    trams = tram_conflicts(net_path, roads)
    return _run_job(net_path, demand, asset, options, job, trams, scratch, progress)


def observe(  # noqa: PLR0913 - all inputs of SUMO
    net_path: Path,
    demand: Demand,
    asset: Callable[[str], Asset],
    *,
    seconds: int,
    step_ms: int,
    seed: int,
    warmup_s: float = 0.0,
    trams: Mapping[str, Any] | None = None,
    outputs: Mapping[str, object] | None = None,
    scratch: Path | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Simulated:
    """Run a circulating demand through SUMO without recording positions.

    Args:
        net_path: the SUMO network.
        demand: the circulating demand.
        asset: returns the mesh of a name, with its length, width and height.
        seconds: duration of the simulation.
        step_ms: SUMO's step.
        seed: SUMO's seed.
        warmup_s: gates add vehicles before this time.
        trams: conflicts of trams with other traffic (``tram_conflicts``).
        outputs: SUMO's options for its own output files, and their values.
        scratch: folder for SUMO's files; ``None``: the system's.
        progress: called with the fraction done and what is being done.

    Raises:
        StageError: SUMO failed; the message holds SUMO's first error.
    """
    options = {**sumo_options(step_ms, seed, circulates=True), **(outputs or {})}
    steps = round(seconds * 1000 / step_ms)
    job: dict[str, Any] = {"warmup_substeps": steps, "first_step": 1, "last_step": 0, "substeps": 1}
    job["staged"], job["gates_until_s"] = [], warmup_s
    return _run_job(net_path, demand, asset, options, job, trams or {}, scratch, progress)


def _run_job(
    net_path: Path,
    demand: Demand,
    asset: Callable[[str], Asset],
    options: dict[str, object],
    job: Mapping[str, Any],
    trams: Mapping[str, Any],
    scratch: Path | None,
    progress: Callable[[float, str], None] | None,
) -> Simulated:
    """Run a job in the worker process."""
    own = passing_folder("urbantwin-sumo") if scratch is None else _folder_in(scratch)
    with own as made:
        folder = made.resolve()
        routes = folder / "demand.rou.xml"
        write_routes(routes, demand, asset)
        stops = folder / "stops.add.xml"
        write_stops(stops, demand)
        whole = {
            **job,
            "classes": [
                *(ACTOR_CLASSES.index(trip.actor_class) for trip in demand.trips),
                *(number for row in job["staged"] for number in row.get("classes", ())),
            ],
            "kinds": len(ACTOR_CLASSES),
            "parties": Counter(str(k - x.beside) for k, x in enumerate(demand.trips) if x.beside),
            "outer": sorted(demand.outer),
            "stuck_s": STUCK_S,
            "curves": curves_of(net_path),
            "trams": trams,
            "one_lane": one_lane_streets(net_path),
            "approaches": demand.approaches,
            "queue_headways": any(IN_QUEUES in manner for manner in demand.manners.values()),
            "boarding": boarding_job(demand.passengers),
            "gates": gates_of(demand, job["gates_until_s"], int(str(options["seed"]))),
        }

        line = _command_line(net_path, routes, {**options, "additional-files": stops})
        files = {"arrays": str(folder / "rows.npy"), "texts": str(folder / "outcome.json")}
        job_text = json.dumps({**whole, "options": line, **files})
        (folder / "job.json").write_text(job_text, encoding="utf-8")
        _run_worker(folder / "job.json", progress)
        warmup_s = job["warmup_substeps"] * float(str(options["step-length"]))
        return _read(folder / "rows.npy", folder / "outcome.json", warmup_s)


@contextmanager
def _folder_in(scratch: Path) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="sumo-", dir=scratch) as name:
        yield Path(name)


def sumo_substeps(step_s: float) -> tuple[int, int]:
    """Return a motion's step in milliseconds, and the number of SUMO's own steps in it.

    Raises:
        InputError: the step is not a whole number of milliseconds, SUMO's resolution of time.
    """
    step_ms = round(step_s * 1000)
    if step_ms < 1 or abs(step_ms - step_s * 1000) > 1e-6:
        raise InputError(
            f"{step_s:g} s is not a step that SUMO can make",
            place="traffic.step_s",
            expected="a whole number of milliseconds, 0.001 or more",
        )
    substeps = next(
        n for n in range(1, step_ms + 1) if step_ms % n == 0 and step_ms / n <= _LARGEST_STEP_MS
    )
    return step_ms, substeps


def sumo_options(sumo_step_ms: int, seed: int, *, circulates: bool = False) -> dict[str, object]:
    """Return SUMO's options for a twin's traffic, and their values.

    Args:
        sumo_step_ms: SUMO's own step.
        seed: SUMO's seed.
        circulates: whether all actors stay: then none is removed, however long it waits.
    """
    # After this time on a junction, a vehicle no longer blocks others: a last resort, so that two
    # that wait for each other do not lock the whole network.
    waits = {"time-to-teleport": _TELEPORT_S, "ignore-junction-blocker": _JUNCTION_BLOCKER_S}
    if circulates:
        # Vehicles are never removed.
        waits |= {"time-to-teleport": -1, "pedestrian.striping.jamtime": _PEDESTRIAN_SQUEEZE_S}
    return {
        "step-length": sumo_step_ms / 1000,
        "seed": seed % 2**31,
        "lateral-resolution": _SUBLANE_M,
        **waits,
        # Collisions are reported only: SUMO's default would remove the vehicle.
        "collision.action": "warn",
        "collision.check-junctions": "true",
        "intermodal-collision.action": "warn",
    }


def _command_line(net_path: Path, routes: Path, how: dict[str, object]) -> list[str]:
    """Return SUMO's command line."""
    options: dict[str, object] = {
        "net-file": net_path.resolve(),
        "route-files": routes,
        **how,
        "no-step-log": "true",
        "duration-log.disable": "true",
        "xml-validation": "never",
        "xml-validation.net": "never",
        "xml-validation.routes": "never",
    }
    return [text for name, value in options.items() for text in (f"--{name}", str(value))]


def _run_worker(job: Path, progress: Callable[[float, str], None] | None) -> None:
    """Run the worker to its end.

    Raises:
        StageError: it failed or died; the message holds SUMO's first error.
    """
    messages = job.with_name("messages.txt")
    # -P: modules in the worker's folder must not shadow others of the same name.
    command = [sys.executable, "-P", str(_WORKER), str(job)]
    with (
        messages.open("wb") as stderr,
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=stderr, encoding="utf-8"
        ) as process,
    ):
        try:
            assert process.stdout is not None
            for line in process.stdout:
                if progress and (match := re.match(r"progress ([0-9.]+)$", line)):
                    progress(float(match[1]), "simulating traffic")
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        raise StageError(f"SUMO failed: {_first_error(messages, process.returncode)}")


def _first_error(messages: Path, returncode: int) -> str:
    """Return SUMO's first error, else its last message, else how the process ended."""
    lines = [
        line.strip() for line in messages.read_text(errors="replace", encoding="utf-8").splitlines()
    ]
    for line in lines:
        if line.startswith("Error:"):
            return line.removeprefix("Error:").strip()
        if match := re.match(r"[\w.]*TraCI(?:Exception|Error): (.+)", line):
            return match[1]
    if returncode < 0:
        return f"its process was ended by {signal.Signals(-returncode).name}"
    return next((line for line in reversed(lines) if line), f"exit code {returncode}")


def _read(arrays: Path, texts: Path, warmup_s: float) -> Simulated:
    """Read the worker's results; the motion begins ``warmup_s`` after SUMO's start."""
    outcome: dict[str, Any] = json.loads(texts.read_text(encoding="utf-8"))
    rows = row_columns(arrays)
    minutes = outcome["minutes"]
    seen = {
        name: np.array([minute[name] for minute in minutes], np.float64)
        for name in ("least", "most", "samples", "metres", "entries")
    }
    seen["seconds"] = np.array([minute["seconds"][0] for minute in minutes], np.float64)
    return Simulated(
        step=rows["step"],
        trip=rows["trip"],
        front=rows["front"],
        angle_deg=rows["angle_deg"],
        speed=rows["speed"],
        lane=rows["lane"],
        lanes=tuple(outcome["lanes"]),
        signals=tuple((step, program, state) for step, program, state in outcome["signals"]),
        teleports=outcome["teleports"],
        collisions=len(outcome["collisions"]),
        collided=tuple((time_s - warmup_s, *rest) for time_s, *rest in outcome["collisions"]),
        departed=frozenset(outcome["departed"]),
        sumo=outcome["sumo"],
        staged=tuple(outcome["staged"]),
        boarded=tuple((time_s - warmup_s, *rest) for time_s, *rest in outcome["boarded"]),
        observed=Observed(
            **seen,
            longest_halt_s=outcome["longest_halt_s"],
            vehicle_halt_s=outcome["vehicle_halt_s"],
            queued=outcome["queued"],
            stuck=tuple((trip, time_s, lane) for trip, time_s, lane in outcome["stuck"]),
        ),
    )
