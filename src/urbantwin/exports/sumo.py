"""The twin as a SUMO scenario: network, vehicle types, routes, buildings, configuration."""

from __future__ import annotations

import shutil
from pathlib import Path

import shapely
from lxml import etree

from urbantwin.artefact import passing_folder, replaced_folder, write_json
from urbantwin.drawing.footprint import footprints
from urbantwin.geometry import LabelledMesh
from urbantwin.traffic import sumo
from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.traffic.fleet_of_twin import own_bodies
from urbantwin.traffic.sumo.driven_net import driven_net
from urbantwin.traffic.sumo.route_file import write_routes
from urbantwin.traffic.sumo.simulation import (
    sumo_options,
    sumo_substeps,
    write_stops,
)
from urbantwin.traffic.sumo.worker_input import curves_of, gates_of, one_lane_streets
from urbantwin.twin import Twin

__all__ = ["write_sumo"]

#: Script that runs the folder with lower speeds in bends.
DRIVER = Path(sumo.__file__).with_name("curves.py")
#: Delay per step in sumo-gui, milliseconds of real time.
DELAY_MS = 50


def write_sumo(twin: Twin, folder: Path) -> None:
    """Write a folder that ``sumo -c twin.sumocfg`` and ``sumo-gui -c twin.sumocfg`` can run.

    ``network.net.xml`` is the network of the traffic stage: the twin's own, with requested counts
    with adapted signals, and with the site's offsets. ``types.add.xml`` and ``demand.rou.xml`` are
    SUMO's inputs for the site's demand, duration and seed. ``buildings.add.xml`` and
    ``view.settings.xml`` are for display. The first second of the motion is SUMO's second
    ``warmup_s``. Settings without a SUMO file format are in ``curves.json`` (speeds in bends),
    ``gates.json`` (metering of vehicles that enter the region) and ``one_lane.json`` (streets where
    vehicles wait for oncoming ones). ``drive.py`` runs the folder with all of them.

    Raises:
        InputError: the folder holds other files, or SUMO cannot use the time step.
    """
    asked = twin.site["traffic"]
    step_ms, substeps = sumo_substeps(float(asked["step_s"]))
    seed, warmup_s = int(asked["seed"]), float(asked["warmup_s"])
    steps = max(1, round(float(asked["duration_s"]) * 1000 / step_ms))
    with replaced_folder(folder, kind="sumo", inputs=[twin.folder]) as scratch:
        duration_s = steps * step_ms / 1000
        demand = demand_of(twin, duration_s=duration_s, seed=seed)
        net = scratch / "network.net.xml"
        with passing_folder("urbantwin-sumo") as made:
            shutil.copyfile(driven_net(twin, asked, demand, duration_s, made), net)
        write_json(scratch / "curves.json", curves_of(net))
        shutil.copyfile(DRIVER, scratch / "drive.py")
        if streets := one_lane_streets(net):
            write_json(scratch / "one_lane.json", streets)
            shutil.copyfile(DRIVER.with_name("one_lane.py"), scratch / "one_lane.py")
        if demand.gates.gates:
            gates = {**gates_of(demand, warmup_s, seed), "outer": sorted(demand.outer)}
            write_json(scratch / "gates.json", gates)
            shutil.copyfile(DRIVER.with_name("gates.py"), scratch / "gates.py")
        write_routes(scratch / "demand.rou.xml", demand, own_bodies(twin).asset)
        write_stops(scratch / "stops.add.xml", demand)
        _split_types(scratch / "demand.rou.xml", scratch / "types.add.xml")
        _write_buildings(scratch / "buildings.add.xml", twin.mesh)
        _write_view(scratch / "view.settings.xml", twin)
        end = warmup_s + steps * step_ms / 1000
        options = sumo_options(step_ms // substeps, seed, circulates=demand.circulates)
        _write_configuration(scratch / "twin.sumocfg", end, options)
        counts = {
            name: sum(trip.actor_class == name for trip in demand.trips if not trip.in_reserve)
            for name in dict.fromkeys(trip.actor_class for trip in demand.trips)
        }
        write_json(
            scratch / "sumo.json",
            {
                "kind": "sumo",
                "twin": twin.manifest["name"],
                "twin_sha256": twin.sha256,
                "seed": seed,
                "warmup_s": warmup_s,
                "duration_s": steps * step_ms / 1000,
                "trips": counts,
            },
        )


def _split_types(routes: Path, types: Path) -> None:
    """Move the vehicle types to a separate file, which SUMO loads before the routes."""
    root = etree.parse(routes).getroot()
    moved = etree.Element("additional")
    for kind in root.findall("vType"):
        moved.append(kind)
    _write(types, moved)
    _write(routes, root)


def _write_buildings(path: Path, mesh: LabelledMesh) -> None:
    root = etree.Element("additional")
    for part, footprint in footprints(mesh, "building").items():
        for number, piece in enumerate(shapely.get_parts(footprint)):
            if piece.geom_type != "Polygon" or piece.is_empty:
                continue
            ring = shapely.get_coordinates(piece.exterior)
            etree.SubElement(
                root,
                "poly",
                id=f"building.{part}.{number}",
                type="building",
                color="150,150,158",
                fill="1",
                layer="-1.00",
                shape=" ".join(f"{x:.2f},{y:.2f}" for x, y in ring),
            )
    _write(path, root)


def _write_view(path: Path, twin: Twin) -> None:
    """Write sumo-gui's initial view: realistic colours, centred on the region."""
    root = etree.Element("viewsettings")
    etree.SubElement(root, "scheme", name="real world")
    middle = twin.region.centroid
    etree.SubElement(root, "viewport", zoom="150", x=f"{middle.x:.2f}", y=f"{middle.y:.2f}")
    _write(path, root)


def _write_configuration(path: Path, end_s: float, options: dict[str, object]) -> None:
    """Write the run's options in their sections of SUMO's documentation."""
    sections: dict[str, dict[str, object]] = {
        "input": {
            "net-file": "network.net.xml",
            "route-files": "demand.rou.xml",
            "additional-files": "types.add.xml,stops.add.xml,buildings.add.xml",
        },
        "time": {"begin": 0, "end": f"{end_s:g}", "step-length": options["step-length"]},
        "processing": {
            name: value for name, value in options.items() if name not in ("step-length", "seed")
        },
        "report": {"no-step-log": "true"},
        "random_number": {"seed": options["seed"]},
        "gui_only": {"gui-settings-file": "view.settings.xml", "delay": DELAY_MS},
    }
    root = etree.Element("sumoConfiguration")
    for section, entries in sections.items():
        element = etree.SubElement(root, section)
        for name, value in entries.items():
            etree.SubElement(element, name, value=str(value))
    _write(path, root)


def _write(path: Path, root: etree._Element) -> None:
    etree.indent(root, space=" ")
    path.write_bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8") + b"\n")
