"""Cross-fall of carriageways: measured in the elevation model, else the usual one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from urbantwin.ground import Elevation
from urbantwin.roads.heights.stations import Stations
from urbantwin.roads.model import ModelRoad

__all__ = [
    "FINE_M",
    "RUN_OUT_M",
    "CrossFall",
    "Limits",
    "cross_falls",
    "limits_of",
    "line_across",
    "run_out",
    "smooth_step",
]

#: Usual fall of a paved carriageway for drainage: from the crown of a two-way street to both sides,
#: on a one-way carriageway to the outer side (AASHTO Green Book 2018, 4.2.2: 1.5 to 2 %).
NORMAL_FALL = 0.02
#: Length before a junction over which the cross-fall runs out, metres.
RUN_OUT_M = 15.0
#: Maximum cell size of an elevation model that shows the cross-fall of a road, metres.
FINE_M = 2.0
#: Minimum width of the carriageway on either side of the reference line for a crown, metres.
SIDE_M = 2.0
#: Margin at the edge, which may contain the curb, metres.
EDGE_M = 0.6
#: Bounds of crowns; larger values come from hedges, walls or parked cars.
CROWNS = (0.0, 0.05)
#: Smoothing of measured values along the road, standard deviation, metres.
ALONG_M = 8.0
#: Residuals beyond this get less weight in the regression (Huber, 1964), metres.
HUBER_M = 0.03
ROUNDS = 4
#: Number of samples across the carriageway.
SAMPLES = 9
#: Steepest grade by class (AASHTO, A Policy on Geometric Design of Highways and Streets, 2018:
#: freeways table 8-1, arterials table 7-4, collectors table 6-8, local streets 5.3.2.3).
GRADE = {
    "motorway": 0.06,
    "motorway_link": 0.07,
    "trunk": 0.07,
    "trunk_link": 0.08,
    "primary": 0.09,
    "primary_link": 0.09,
    "secondary": 0.10,
    "secondary_link": 0.10,
    "tertiary": 0.12,
    "tertiary_link": 0.12,
}
GRADE_OF_LOCAL_STREETS = 0.15
#: Maximum superelevation by class (the same, 3.3.3.2: 4 to 6 % in towns, 8 % on freeways).
BANK = {"motorway": 0.08, "motorway_link": 0.08, "trunk": 0.06, "trunk_link": 0.06}
BANK_OF_STREETS = 0.06
#: Design speeds, km/h, and the rates of vertical curvature K there: metres of curve per percent of
#: change in grade, on crests (the same, table 3-35) and in sags (table 3-37).
SPEEDS = (20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120, 130)
CREST_K = (1, 2, 4, 7, 11, 17, 26, 39, 52, 74, 95, 124)
SAG_K = (3, 6, 9, 13, 18, 23, 30, 38, 45, 55, 63, 73)


@dataclass(frozen=True)
class CrossFall:
    """Cross-fall of the ground and of carriageways at stations.

    Attributes:
        ground: (M,) height of the ground at the reference line, from a line fitted across, metres.
        tilt: (M,) rise of the ground per metre to the left.
        level: (M,) target height of the road at the reference line, metres.
        bank: (M,) target rise of the road per metre to the left.
        crown: (R,) fall of the road to both sides, before its run-out towards junctions.
        measured: (R,) whether the road's own cross-fall was measured in the ground.
    """

    ground: NDArray[np.float64]
    tilt: NDArray[np.float64]
    level: NDArray[np.float64]
    bank: NDArray[np.float64]
    crown: NDArray[np.float64]
    measured: NDArray[np.bool_]


@dataclass(frozen=True)
class Limits:
    """Limits of a street's geometric design.

    Attributes:
        grade: maximum grade.
        crest: maximum curvature of a crest in the profile, 1/m.
        sag: maximum curvature of a sag, 1/m.
        bank: maximum superelevation, as a slope.
    """

    grade: float
    crest: float
    sag: float
    bank: float


def cross_falls(
    stations: Stations,
    t: NDArray[np.float64],
    z: NDArray[np.float64],
    weight: NDArray[np.float64],
    elevation: Elevation,
    limits: list[Limits],
    lifted: NDArray[np.bool_],
    share: NDArray[np.float64],
) -> CrossFall:
    """Return the cross-fall of streets.

    Args:
        stations: stations of the streets.
        t: (M, K) offsets across the carriageway, metres to the left.
        z: (M, K) smoothed ground there, including the lift of the road, metres.
        weight: (M, K) weights of these samples.
        elevation: the ground, for the measurement.
        limits: limits of each street.
        lifted: (R,) whether a street is above the ground anywhere.
        share: (M,) share of its cross-fall that a street has (``run_out``).
    """
    ground, tilt = line_across(t, z, weight)
    side = np.array([_outer_side(road) for road in stations.roads], np.float64)
    reach = np.minimum(stations.left, -stations.right)
    sided = np.minimum.reduceat(reach, stations.first[:-1]) > SIDE_M
    bridge = np.array([road.level > 0 for road in stations.roads])
    crown = np.where(sided & (side == 0) & ~bridge, NORMAL_FALL, 0.0)
    fall = np.where(bridge, 0.0, -side * NORMAL_FALL)[stations.road]
    level, bank = ground, tilt + fall * share
    width = np.minimum.reduceat(stations.left - stations.right, stations.first[:-1])
    measured = (
        ~lifted & (width > 2.5 * elevation.detail) & (elevation.detail <= FINE_M)
        if not elevation.is_flat
        else np.zeros(len(lifted), bool)
    )
    if measured.any():
        seen = _measured(stations, elevation, ground, tilt, sided & (side == 0))
        is_measured = measured[stations.road]
        level = np.where(is_measured, ground + (seen[0] - ground) * share, level)
        bank = np.where(is_measured, tilt + (seen[1] - tilt) * share, bank)
        crown = np.where(measured, seen[2], crown)
    steepest = np.array([limit.bank for limit in limits])[stations.road]
    # A carriageway that is too steep is rotated about its centre.
    cut = (bank - np.clip(bank, -steepest, steepest)) * share
    middle = (stations.left + stations.right) / 2
    return CrossFall(ground, tilt, level + cut * middle, bank - cut, crown, measured)


def run_out(
    stations: Stations, calm: Mapping[int, Sequence[tuple[float, float]]]
) -> NDArray[np.float64]:
    """Return the share (M,) of its cross-fall that a street has: 0 at connections, else 1.

    Args:
        stations: stations of the streets.
        calm: id of a street -> ranges of stations without cross-fall.
    """
    length = np.array([road.length for road in stations.roads])[stations.road]
    gap_m = np.full(len(length), np.inf)
    for k, road in enumerate(stations.roads):
        part = stations.of(k)
        s = stations.s[part]
        spans = list(calm.get(road.id, ()))
        spans += [(0.0, 0.0)] * (road.predecessor is not None)
        spans += [(road.length, road.length)] * (road.successor is not None)
        for first, last in spans:
            gap_m[part] = np.minimum(gap_m[part], np.maximum(np.maximum(first - s, s - last), 0.0))
    # Streets too short for a run-out at both ends have a smaller share in the middle.
    return smooth_step(gap_m / np.minimum(RUN_OUT_M, length / 2)) * smooth_step(
        length / (2.0 * RUN_OUT_M)
    )


def smooth_step(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a smooth step from 0 at 0 to 1 at 1."""
    u = np.clip(u, 0.0, 1.0)
    return np.asarray(u * u * (3.0 - 2.0 * u))


def line_across(
    t: NDArray[np.float64], z: NDArray[np.float64], weight: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return height at t = 0 and slope (M,) of least-squares lines through samples (M, K)."""
    w = np.ones_like(t) if weight is None else weight
    w = w / w.sum(axis=1, keepdims=True)
    middle = (w * t).sum(axis=1)
    spread = t - middle[:, None]
    slope = (w * spread * z).sum(axis=1) / np.maximum((w * spread**2).sum(axis=1), 1e-9)
    return np.asarray((w * z).sum(axis=1) - slope * middle), np.asarray(slope)


def _outer_side(road: ModelRoad) -> int:
    """Return 0 for a two-way street; else the outer side of a one-way road: 1 left, -1 right."""
    lanes = [lane for section in road.sections for lane in section.lanes if lane.allowed]
    if shared := [lane for lane in lanes if lane.opposite]:
        return int(np.sign(shared[0].id))
    if len({lane.forward for lane in lanes}) == 2:
        return 0
    return int(np.sign(sum(np.sign(lane.id) for lane in lanes)))


def _measured(
    stations: Stations,
    elevation: Elevation,
    ground: NDArray[np.float64],
    tilt: NDArray[np.float64],
    crowned: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return level (M,), bank (M,) and crown (R,) by robust local regression on the raw ground."""
    half = (stations.left - stations.right) / 2
    t = stations.across(SAMPLES, margin=np.minimum(EDGE_M, half / 3))
    heights = elevation.raw_at(stations.beside(t).reshape(-1, 2)).reshape(t.shape)
    # Variation of the smoothed ground along the road is removed: the regression is across.
    heights = heights - ground[:, None] - tilt[:, None] * t
    crown = np.zeros(len(stations.roads))
    if crowned.any():
        # The first fit determines one crown per street; the second the rest, with that crown fixed.
        kink = _regressed(stations, heights, [np.ones_like(t), t, -np.abs(t)])[2]
        for k in np.flatnonzero(crowned).tolist():
            crown[k] = np.clip(np.median(kink[stations.of(k)]), *CROWNS)
    flat = heights + crown[stations.road][:, None] * np.abs(t)
    level, bank = _regressed(stations, flat, [np.ones_like(t), t])
    return ground + level, tilt + bank, crown


def _regressed(
    stations: Stations, z: NDArray[np.float64], columns: list[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Fit z (M, K) by columns (M, K), locally along each road; return coefficients (C, M)."""
    design = np.stack(columns, axis=-1)
    count = design.shape[-1]
    weight = np.ones_like(z)
    coefficients = np.zeros((len(z), count))
    for _ in range(ROUNDS):
        weighted = design * weight[..., None]
        system = np.concatenate(
            [
                np.einsum("mki,mkj->mij", weighted, design).reshape(len(z), -1),
                np.einsum("mki,mk->mi", weighted, z),
            ],
            axis=1,
        )
        for k, road in enumerate(stations.roads):
            part = stations.of(k)
            step = road.length / (part.stop - part.start - 1)
            system[part] = gaussian_filter1d(system[part], ALONG_M / step, axis=0, mode="nearest")
        normal = system[:, : count * count].reshape(-1, count, count)
        normal = normal + 1e-6 * np.eye(count)
        coefficients = np.linalg.solve(normal, system[:, count * count :, None])[..., 0]
        residual = np.abs(z - np.einsum("mki,mi->mk", design, coefficients))
        weight = np.minimum(1.0, HUBER_M / np.maximum(residual, 1e-9))
    return coefficients.T


def limits_of(road: ModelRoad) -> Limits:
    """Return the design limits for a road's class and its highest speed limit."""
    limit = max(
        (lane.speed_limit for section in road.sections for lane in section.lanes), default=0.0
    )
    speed = (limit or 50.0 / 3.6) * 3.6
    return Limits(
        grade=GRADE.get(road.kind, GRADE_OF_LOCAL_STREETS),
        crest=0.01 / float(np.interp(speed, SPEEDS, CREST_K)),
        sag=0.01 / float(np.interp(speed, SPEEDS, SAG_K)),
        bank=BANK.get(road.kind, BANK_OF_STREETS),
    )
