"""Bicycles, scooters, motorcycles and wheelchairs with their riders."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.traffic.assets.person import Figure, Posture, bent, figure_solids
from urbantwin.traffic.assets.solid import Solid, cylinder, parts, place, ring

__all__ = ["PEDAL_PHASES", "hub_contacts", "two_wheeler"]

#: Number of positions of the cranks in a turn; in the first the left pedal is ahead and below.
PEDAL_PHASES = 8
#: Height of the foot's sole above a pedal, peg or floor board, metres.
SOLE = 0.02


def two_wheeler(entry: Mapping[str, Any], phase: int = 0, *, halted: bool = False) -> list[Solid]:
    """Return the solids of a two-wheeler and its rider.

    Args:
        entry: entry of the catalogue.
        phase: position of the cranks, for an entry with cranks.
        halted: the rider stands with the left foot on the ground (both feet on a motorcycle).
    """
    length = entry["size"][0]
    solids = parts(entry)
    for from_nose in entry["wheels"]["hubs"]:
        wheel = _wheel(entry["wheels"], length / 2 - from_nose)
        for y in _tracks(entry):
            solids += [solid.moved([0.0, y, 0.0]) for solid in wheel]
    feet = np.array([place(foot, length) for foot in entry["rider"]["feet"]])
    if "cranks" in entry:
        feet = _pedals(entry, phase)
        solids += _cranks(entry, feet)
    for rider in (key for key in ("rider", "passenger") if key in entry):
        person = entry[rider]
        if rider == "passenger":
            feet = np.array([place(foot, length) for foot in person["feet"]])
        figure = Figure(**person["figure"])
        solids += figure_solids(figure, _seated(person, figure, feet, length, halted=halted))
    return solids


def hub_contacts(entry: Mapping[str, Any]) -> list[list[float]]:
    """Return the wheels' contact points (K, 3), the front first, left before right."""
    length = entry["size"][0]
    hubs = entry["wheels"]["hubs"]
    return [[length / 2 - from_nose, y, 0.0] for from_nose in hubs for y in _tracks(entry)]


def _tracks(entry: Mapping[str, Any]) -> tuple[float, ...]:
    """Return the lateral positions of an axle's wheels: in the middle, or on both sides."""
    half = entry["wheels"].get("half_track", 0.0)
    return (half, -half) if half else (0.0,)


def _wheel(wheels: Mapping[str, Any], x: float) -> list[Solid]:
    """Return a tyre with a hub and spokes, or with a disc."""
    radius, tyre = wheels["diameter"] / 2, wheels["tyre"]
    hub = np.array([x, 0.0, radius])
    across = np.array([0.0, 1.0, 0.0])
    solids = [ring(hub, radius, tyre, "rubber", sides=28, section_sides=6)]
    inner = radius - 0.8 * tyre
    if not wheels.get("spokes"):
        half = 0.25 * tyre
        disc = cylinder(hub - half * across, hub + half * across, inner, "metal-dark", sides=20)
        return [*solids, disc]
    solids.append(cylinder(hub - 0.05 * across, hub + 0.05 * across, 0.02, "metal-dark", sides=8))
    for number in range(wheels["spokes"]):
        angle = 2 * np.pi * (number + 0.5) / wheels["spokes"]
        rim = hub + inner * np.array([np.cos(angle), 0.0, np.sin(angle)])
        side = 0.03 * across * (-1) ** number
        solids.append(cylinder(hub + side, rim, 0.003, "metal-dark", sides=4))
    return solids


def _pedals(entry: Mapping[str, Any], phase: int) -> NDArray[np.float64]:
    """Return the left and the right pedal (2, 3)."""
    cranks = entry["cranks"]
    centre = place([cranks["axle"][0], 0.0, cranks["axle"][1]], entry["size"][0])
    # Forward motion turns the cranks clockwise seen from the right.
    angle = -np.radians(50) - 2 * np.pi * phase / PEDAL_PHASES
    reach = cranks["length"] * np.array([np.cos(angle), 0.0, np.sin(angle)])
    out = np.array([0.0, cranks["half_width"], 0.0])
    return np.array([centre + reach + out, centre - reach - out])


def _cranks(entry: Mapping[str, Any], pedals: NDArray[np.float64]) -> list[Solid]:
    """Return cranks, pedals and the chain ring."""
    middle = pedals.mean(axis=0)
    solids = [
        cylinder(middle + [0, -0.055, 0], middle + [0, -0.045, 0], 0.09, "metal-dark", sides=16)
    ]
    for side, pedal in zip((1, -1), pedals, strict=True):
        inner = np.array([0.0, 0.05 * side, 0.0])
        end = pedal - [0.0, 0.05 * side, 0.0]
        solids.append(cylinder(middle + inner, end, 0.012, "metal-dark", sides=6))
        solids.append(
            cylinder(pedal - [0.03, 0, 0], pedal + [0.03, 0, 0], 0.025, "retroreflector", sides=4)
        )
    return solids


def _seated(
    person: Mapping[str, Any],
    figure: Figure,
    feet: NDArray[np.float64],
    length: float,
    *,
    halted: bool,
) -> Posture:
    """Return the posture of a rider: pelvis on the saddle, hands on the bars, feet at given points.

    Args:
        person: ``pelvis`` [behind, up], ``lean`` of the trunk in degrees, ``grip`` (left hand),
            outward angle factors of ``knees`` and ``elbows``; ``halt`` has the ``pelvis`` and the
            position [behind, left] of the ``foot`` on the ground (of both feet with ``both``).
        figure: the rider's build.
        feet: (2, 3) positions of the balls of the left and the right foot.
        length: length of the vehicle, metres.
        halted: whether the vehicle stands.
    """
    from_nose, up = person["pelvis"]
    lean = np.radians(person["lean"])
    ground = [False, False]
    if halted and "halt" in person:
        halt = person["halt"]
        (from_nose, up), (foot_behind, foot_left) = halt["pelvis"], halt["foot"]
        lean = np.radians(halt.get("lean", person["lean"]))
        ground = [True, halt.get("both", False)]
        down = place([foot_behind, foot_left, 0.0], length)
        feet = np.where(np.array(ground)[:, None], [down, down * [1, -1, 1]], feet)
    pelvis = place([from_nose, 0.0, up], length)
    spine = np.array([np.sin(lean), 0.0, np.cos(lean)])
    neck = pelvis + figure.length("trunk") * spine
    legs, arms = [], []
    for number, side in enumerate((1.0, -1.0)):
        hip = pelvis + [0.0, side * figure.length("hip"), 0.0]
        legs.append(_leg(figure, hip, feet[number], person["knees"] * side, ground[number]))
        shoulder = pelvis + 0.97 * (neck - pelvis)
        shoulder = shoulder + [0.0, side * figure.length("shoulder"), 0.0]
        grip = place(person["grip"], length) * [1.0, side, 1.0]
        arms.append(_arm(figure, shoulder, grip, side, person.get("elbows", 0.25)))
    return Posture(pelvis, neck, 0.1, np.array(legs), np.array(arms))


def _leg(
    figure: Figure, hip: NDArray[np.float64], ball: NDArray[np.float64], out: float, down: bool
) -> NDArray[np.float64]:
    """Return hip, knee, ankle and toes (4, 3) of a leg with the ball of the foot at a point."""
    pitch = 0.0 if down else -0.15
    ahead = np.array([np.cos(pitch), 0.0, np.sin(pitch)])
    up = np.array([-np.sin(pitch), 0.0, np.cos(pitch)])
    foot, rise = 0.72 * figure.length("foot"), figure.length("ankle")
    sole = ball + up * (0.0 if down else SOLE)
    ankle = sole - 0.75 * foot * ahead + rise * up
    tip = ankle + foot * ahead - rise * up
    thigh, shank = figure.length("thigh"), figure.length("shank")
    knee = bent(hip, ankle, thigh, shank, [1.0, out, 0.2])
    return np.array([hip, knee, ankle, tip])


def _arm(
    figure: Figure,
    shoulder: NDArray[np.float64],
    grip: NDArray[np.float64],
    side: float,
    elbows: float,
) -> NDArray[np.float64]:
    """Return shoulder, elbow, wrist and knuckles (4, 3) of an arm that holds a grip."""
    reach = (grip - shoulder) / np.linalg.norm(grip - shoulder)
    wrist = grip - 0.05 * reach + [0.0, 0.0, 0.015]
    elbow = bent(
        shoulder,
        wrist,
        figure.length("upper-arm"),
        figure.length("forearm"),
        [-0.3, elbows * side, -0.7],
    )
    return np.array([shoulder, elbow, wrist, grip + 0.02 * reach + [0.0, 0.0, 0.015]])
