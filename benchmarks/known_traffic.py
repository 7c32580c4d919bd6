"""Recordings of a place whose truth is known, and is nobody's that we simulate by default.

SUMO alone drives them (its own program, not our worker): another car-following model with drivers
of its own, arrivals in platoons from signals upstream, other volumes, classes and signal timing. A
tracker sees who is near the junction: with errors, gaps, and tracks that break in two.
"""

from __future__ import annotations

import csv
import math
import re
import subprocess
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.signal import lfilter

from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.roads.netconvert import sumo_binary, sumo_environment
from urbantwin.traffic.calibration.passages import SeenTrack
from urbantwin.traffic.demand.counted_places import main_junction
from urbantwin.traffic.demand.demand import Routes
from urbantwin.traffic.demand.site_demand import outer_roads
from urbantwin.traffic.recorded.track import RecordedTrack
from urbantwin.twin import Twin

__all__ = ["Truth", "drive", "seen_by_a_tracker", "write_recording"]

WARMUP_S, STEP_S = 600.0, 0.2
#: A tracker sees so far, metres; its errors last so long, seconds.
SEES_M, ERROR_LASTS_S = 90.0, 1.0
#: Class -> SUMO's class, and lengths, widths, heights of its kinds, metres.
KINDS: dict[str, tuple[str, tuple[tuple[float, float, float], ...]]] = {
    "car": ("passenger", ((3.7, 1.65, 1.5), (4.3, 1.8, 1.5), (4.8, 1.9, 1.6))),
    "van": ("delivery", ((5.4, 2.0, 2.3), (6.0, 2.0, 2.7))),
    "truck": ("truck", ((7.5, 2.4, 3.2), (9.5, 2.5, 3.6))),
    "bus": ("bus", ((12.0, 2.55, 3.1),)),
    "motorcycle": ("motorcycle", ((2.1, 0.8, 1.6),)),
    "bicycle": ("bicycle", ((1.8, 0.6, 1.7),)),
    "pedestrian": ("pedestrian", ((0.5, 0.5, 1.7),)),
}


@dataclass(frozen=True)
class Truth:
    """What is true of a recording.

    Attributes:
        per_hour: motor vehicles, over all gates.
        shares: of them, by class.
        bicycles: per hour.
        people: per hour.
        drivers: attributes of SUMO's vehicle types of motor traffic.
        greens: greens of the junction's program last so many times as long, in turn.
        actuated: whether the program reacts to who comes.
        cycle_s: of the signals upstream.
        platoon_share: of motor traffic, how many come in their green.
        green_share: of their cycle that is green.
        error_m: standard deviation of a tracker's errors.
        breaks: share of tracks that break in two.
        gaps: share of tracks with a gap.
    """

    per_hour: float
    shares: dict[str, float]
    bicycles: float
    people: float
    drivers: dict[str, str]
    greens: tuple[float, ...]
    actuated: bool = False
    cycle_s: float = 80.0
    platoon_share: float = 0.75
    green_share: float = 0.4
    error_m: float = 0.15
    breaks: float = 0.08
    gaps: float = 0.3
    sublane_m: float = field(default=0.0)


def drive(twin: Twin, truth: Truth, seconds: float, seed: int, folder: Path) -> list[SeenTrack]:
    """Drive a truth and return everybody who was near the junction, without any error."""
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    program = signal_program(twin, truth, folder / "signals.add.xml", folder / "states.xml")
    sizes = write_traffic(twin, truth, seconds, seed, folder / "traffic.rou.xml")
    command: dict[str, object] = {
        "net-file": twin.net_path.resolve(),
        "route-files": folder / "traffic.rou.xml",
        "step-length": STEP_S,
        "end": WARMUP_S + seconds,
        "seed": seed,
        "fcd-output": folder / "fcd.xml",
        "fcd-output.attributes": "x,y,angle,speed,type",
        "device.fcd.begin": WARMUP_S,
        "time-to-teleport": 300,
        "no-step-log": "true",
        "no-warnings": "true",
        "xml-validation": "never",
    }
    if truth.sublane_m:
        command["lateral-resolution"] = truth.sublane_m
    if program:
        command["additional-files"] = folder / "signals.add.xml"
    given = [text for name, value in command.items() for text in (f"--{name}", str(value))]
    subprocess.run([sumo_binary("sumo"), *given], check=True, env=sumo_environment())
    found = near_the_junction(twin, folder / "fcd.xml", sizes)
    (folder / "fcd.xml").unlink()
    return found


def signal_program(twin: Twin, truth: Truth, path: Path, states: Path) -> str:
    """Write the junction's program with other greens; return its id, empty without any."""
    root = ElementTree.parse(twin.net_path).getroot()
    junction = main_junction(twin.roads)
    lights = [
        row.get("tl")
        for row in root.iter("connection")
        if row.get("tl") and (row.get("via") or "").startswith(f":{junction}_")
    ]
    if not lights:
        return ""
    (program,) = (row for row in root.iter("tlLogic") if row.get("id") == lights[0])
    program.set("programID", "recorded")
    program.set("type", "actuated" if truth.actuated else "static")
    number = 0
    for phase in program.iter("phase"):
        seconds, state = float(phase.get("duration", "0")), phase.get("state", "")
        if "y" in state or "G" not in state or seconds < 5:
            continue
        factor = truth.greens[number % len(truth.greens)]
        number += 1
        longer = max(5.0, round(seconds * factor))
        phase.set("duration", f"{longer:g}")
        if truth.actuated:
            phase.set("minDur", f"{max(5.0, round(0.6 * longer)):g}")
            phase.set("maxDur", f"{round(1.3 * longer):g}")
    told = ElementTree.Element("additional")
    told.append(program)
    ElementTree.SubElement(
        told, "timedEvent", type="SaveTLSStates", source=lights[0] or "", dest=str(states)
    )
    ElementTree.ElementTree(told).write(path)
    return str(lights[0])


def write_traffic(
    twin: Twin, truth: Truth, seconds: float, seed: int, path: Path
) -> dict[str, tuple[str, tuple[float, float, float]]]:
    """Write who drives and walks; return type -> (class, size).

    Which ways are taken how much is the place's (drawn once, whatever the seed); who comes when is
    chance.
    """
    outer = outer_roads(twin) if twin.site.get("closed_loop") else frozenset()
    network = StreetNetwork(twin.net_path, twin.region, without=outer)
    place = np.random.Generator(np.random.Philox(key=[7, 3000]))
    chance = np.random.Generator(np.random.Philox(key=[seed, 3001]))
    lines, sizes = types_of(truth)
    lines += vehicles(network, truth, WARMUP_S + seconds, place, chance)
    lines += walkers(network, truth, WARMUP_S + seconds, place, chance)
    with path.open("w", encoding="utf-8") as file:
        file.write("<routes>\n")
        for number, (_, line) in enumerate(sorted(lines)):
            kind = "person" if line.endswith("</person>") else "vehicle"
            file.write(line if line.startswith("<") else f'<{kind} id="{number}" {line}')
            file.write("\n")
        file.write("</routes>\n")
    return sizes


def types_of(
    truth: Truth,
) -> tuple[list[tuple[float, str]], dict[str, tuple[str, tuple[float, float, float]]]]:
    """Return SUMO's vehicle types, as lines, and type -> (class, size)."""
    lines, sizes = [], {}
    of_class = {
        "bicycle": {"maxSpeed": "5.5", "speedFactor": "normc(1,0.2,0.5,1.5)"},
        "pedestrian": {"desiredMaxSpeed": "1.2", "speedFactor": "normc(1,0.15,0.6,1.5)"},
        "truck": {**truth.drivers, "accel": "1.2"},
        "bus": {**truth.drivers, "accel": "1.2"},
    }
    for name, (vclass, every) in KINDS.items():
        for number, (length, width, height) in enumerate(every):
            kind = f"{name}{number}"
            sizes[kind] = name, (length, width, height)
            values = {"length": length, "width": width, "height": height}
            values |= of_class.get(name, truth.drivers)
            told = " ".join(f"{k}={quoteattr(str(v))}" for k, v in values.items())
            lines.append((-1.0, f'<vType id="{kind}" vClass="{vclass}" {told}/>'))
    return lines, sizes


def vehicles(
    network: StreetNetwork,
    truth: Truth,
    whole: float,
    place: np.random.Generator,
    chance: np.random.Generator,
) -> list[tuple[float, str]]:
    """Return when each vehicle and bicycle sets out, and the rest of its line."""
    lines = []
    mix = {"bicycle": truth.bicycles}
    mix |= {name: truth.per_hour * share for name, share in truth.shares.items()}
    usual: dict[str, float] = {}
    for name in (*truth.shares, "bicycle"):
        streets = network.driven_by(KINDS[name][0])
        routes = None if streets is None else Routes.between_gates(streets)
        if routes is None:
            continue
        ways = [routes.drive(k) for k in range(len(routes.pairs))]
        weight = np.array(routes.weight, float)
        for k, way in enumerate(ways):  # the place's own: as nobody guesses it
            ends = f"{way[0]} {way[-1]}"
            if ends not in usual:
                usual[ends] = float(np.exp(0.6 * place.standard_normal()))
            weight[k] *= usual[ends] * (np.exp(0.5 * place.standard_normal()) if weight[k] else 1)
        gates = {way[0]: place.random() for way in ways}
        count = chance.poisson(mix[name] * whole / 3600)
        for way in chance.choice(len(ways), count, p=weight / weight.sum()):
            at = chance.random() * whole
            if name != "bicycle" and chance.random() < truth.platoon_share:
                at = float(in_green(at, truth, gates[ways[way][0]], chance))
            kind = f"{name}{chance.integers(len(KINDS[name][1]))}"
            where = 'departLane="best" departSpeed="max"'
            route = f'<route edges="{" ".join(ways[way])}"/>'
            lines.append((at, f'type="{kind}" depart="{at:.2f}" {where}>{route}</vehicle>'))
    return lines


def walkers(
    network: StreetNetwork,
    truth: Truth,
    whole: float,
    place: np.random.Generator,
    chance: np.random.Generator,
) -> list[tuple[float, str]]:
    """Return when each person sets out, and the rest of its line."""
    walked = network.walked()
    routes = None if walked is None else Routes.between_gates(walked)
    if routes is None or not truth.people:
        return []
    lines = []
    weight = routes.weight * np.exp(0.6 * place.standard_normal(len(routes.weight)))
    count = chance.poisson(truth.people * whole / 3600)
    for way in chance.choice(len(weight), count, p=weight / weight.sum()):
        at = chance.random() * whole
        edges, begin, end = routes.walk(int(way), 0.0, 0.0)
        walk = f'<walk edges="{" ".join(edges)}" arrivalPos="{end:.2f}"/>'
        told = f'type="pedestrian0" depart="{at:.2f}" departPos="{begin:.2f}">{walk}</person>'
        lines.append((at, told))
    return lines


def in_green(at: float, truth: Truth, phase: float, chance: np.random.Generator) -> float:
    """Return a moment of the green of the cycle that a moment lies in; phase: of the gate."""
    begin = (at // truth.cycle_s + phase) * truth.cycle_s
    return max(begin + chance.random() * truth.green_share * truth.cycle_s, 0.0)


def near_the_junction(
    twin: Twin, fcd: Path, sizes: dict[str, tuple[str, tuple[float, float, float]]]
) -> list[SeenTrack]:
    """Return who was within 90 m of the junction, by SUMO's output, from the warm-up on."""
    (junction,) = (one for one in twin.roads.junctions if one.id == main_junction(twin.roads))
    middle = np.array(junction.polygon.centroid.coords[0])
    rows: dict[str, list[tuple[float, float, float, float, float]]] = defaultdict(list)
    kinds: dict[str, str] = {}
    time_s = 0.0
    with fcd.open(encoding="utf-8") as file:
        for line in file:  # a line each, thousands of times as many as anything else here
            told = dict(re.findall(r'(\w+)="([^"]*)"', line))
            kind = line.lstrip()[1:2]
            if line.lstrip().startswith("<timestep"):
                time_s = float(told["time"]) - WARMUP_S
            elif kind in ("v", "p") and "x" in told and time_s >= 0:
                x, y, angle, speed = (float(told[k]) for k in ("x", "y", "angle", "speed"))
                if math.hypot(x - middle[0], y - middle[1]) < SEES_M + 10:
                    name = f"{kind}{told['id']}"
                    kinds[name] = told["type"]
                    rows[name].append((time_s, x, y, math.pi / 2 - math.radians(angle), speed))
    found = []
    for name, moments in rows.items():
        actor_class, size = sizes[kinds[name]]
        times, x, y, yaw, speed = np.array(moments).T
        ahead = np.column_stack([np.cos(yaw), np.sin(yaw)])
        back = 0.0 if actor_class == "pedestrian" else size[0] / 2
        xy = np.column_stack([x, y]) - ahead * back
        inside = np.flatnonzero(np.linalg.norm(xy - middle, axis=1) < SEES_M)
        # Who leaves and comes back is somebody else; so is a walker whom SUMO sets down elsewhere.
        broken = np.diff(times[inside]) > 1.5 * STEP_S
        fastest = 10 if actor_class == "pedestrian" else 60
        broken |= np.linalg.norm(np.diff(xy[inside], axis=0), axis=1) > fastest * STEP_S
        for part in np.split(inside, np.flatnonzero(broken) + 1):
            if len(part) < 5:
                continue
            nothing = np.full(len(part), np.nan)
            track = RecordedTrack(
                f"{name}-{part[0]}",
                *(actor_class, times[part], xy[part], yaw[part], nothing, np.array(size)),
            )
            found.append(SeenTrack(track, times[part], xy[part], yaw[part], speed[part]))
    return sorted(found, key=lambda one: (one.time_s[0], one.track.name))


def seen_by_a_tracker(
    tracks: list[SeenTrack], truth: Truth, seed: int
) -> list[tuple[str, SeenTrack, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]:
    """Return tracks as a tracker has them: (id, track, xy, yaw, size), gaps and breaks within."""
    chance = np.random.Generator(np.random.Philox(key=[seed, 3002]))
    found, number = [], 0
    keeps = np.exp(-STEP_S / ERROR_LASTS_S)
    for one in tracks:
        count = len(one.time_s)
        steps = chance.standard_normal((count, 2)) * np.sqrt(1 - keeps**2)
        steps[0] /= np.sqrt(1 - keeps**2)
        error = lfilter([1.0], [1.0, -keeps], steps, axis=0) * truth.error_m
        xy = one.xy + error + 0.03 * chance.standard_normal((count, 2))
        yaw = one.yaw + np.radians(2.0) * chance.standard_normal(count)
        size = one.track.size * (1 + 0.05 * chance.standard_normal(3))
        cuts = [np.arange(count)]
        if count > 40 and chance.random() < truth.gaps:
            at, lost = chance.integers(10, count - 20), chance.integers(3, 8)
            cuts = [np.r_[0:at, at + lost : count]]
            if chance.random() < truth.breaks / truth.gaps:
                cuts = [np.arange(at), np.arange(at + lost, count)]
        for part in cuts:
            number += 1
            kept = SeenTrack(
                one.track, one.time_s[part], one.xy[part], one.yaw[part], one.speed[part]
            )
            found.append((f"{number}", kept, xy[part], yaw[part], size))
    return found


def write_recording(
    twin: Twin, tracks: list[SeenTrack], truth: Truth, states: Path, seed: int, folder: Path
) -> Path:
    """Write what the tracker saw as a table, the signals' states, and their description."""
    with (folder / "tracks.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["track_id", "time_s", "class", "x", "y", "yaw_rad", "length", "width"])
        for name, one, xy, yaw, size in seen_by_a_tracker(tracks, truth, seed):
            for k, at in enumerate(one.time_s):
                values = *xy[k], yaw[k], *size[:2]
                moment = f"{at:.2f}", one.track.actor_class
                rows.writerow([name, *moment, *(f"{value:.3f}" for value in values)])
    described: dict[str, object] = {
        "tracks": "tracks.csv",
        "origin": {"latitude": twin.frame.latitude, "longitude": twin.frame.longitude},
    }
    if states.exists():
        described["signals"] = {
            "file": "phases.csv", "group": "group", "time": "time_s", "state": "state",
        }  # fmt: skip
        write_phases(states, folder / "phases.csv")
    path = folder / "tracks.yaml"
    path.write_text(yaml.safe_dump(described))
    return path


def write_phases(states: Path, path: Path) -> None:
    """Write what groups of signals showed: links that always show the same are one."""
    moments = [
        (float(row.get("time", 0)) - WARMUP_S, row.get("state", ""))
        for row in ElementTree.parse(states).getroot().iter("tlsState")
    ]
    columns = sorted({"".join(c) for c in zip(*(s for _, s in moments), strict=True)})
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["group", "time_s", "state"])
        for group, column in enumerate(columns):
            before = ""
            for (at, _), letter in zip(moments, column, strict=True):
                if at >= 0 and letter != before:
                    rows.writerow([group, f"{at:.1f}", letter])
                    before = letter
