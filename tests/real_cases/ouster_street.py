"""A real OS1-128 against the simulated one: beams, drop-out, range noise, brightness of asphalt.

Three scans of a street in San Francisco by a slowly moving sensor. Nothing is fitted: the
simulated side gets the reflectivity that the real sensor reports of the surroundings of a pixel,
and from there on all is `ReturnModel`. Real and simulated numbers come from the same estimators:

- A pixel lies on a surface where a row's nearest returns on both sides, at most 4 columns away,
  agree within 3 %. Whether the pixel itself returned plays no part in that, so the share of
  such pixels that are missing is the rate of drop-out on surfaces.
- Range noise is what 9 neighbours in a row leave around a parabola in 1/range: on a plane 1/range
  is a sine of the azimuth, and the sensor's own motion is as smooth. Both sides count in 8 mm.
- Ground is what lies near the plane of the road; the surface around it decides its cosine.
"""

from __future__ import annotations

import itertools
import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import beam_directions, place_rig, sensor
from urbantwin.lidar.returns import ReturnModel, scatter_of_materials, standard_noise
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import material_id, semantic_id

NAME = "OS-1-128_v2.3.0_1024x10"
ROWS, COLUMNS, STEP_M = 128, 1024, 0.008
REACH, AGREE, WINDOW, EVEN = 4, 0.03, 9, 0.3
RANGES_M = (5, 8, 11, 15, 18, 21, 25, 30, 35, 40, 50, 60, 80, 120)
STRENGTHS = (0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0)
#: Nearer than this the sensor reports asphalt darker the nearer it is: its optics overlap there.
OVERLAP_M = 9.0


@dataclass(frozen=True)
class Recording:
    """S scans: ranges in metres (0: no return) and reflectivity 0..255, both (S, 128, 1024)."""

    range_m: np.ndarray
    reflectivity: np.ndarray
    metadata: dict

    def points(self) -> np.ndarray:
        """(S, 128, 1024, 3) in the sensor frame: the documentation's "Lidar Range to XYZ"."""
        return self.range_m[..., None] * directions()


def directions() -> np.ndarray:
    """(128, 1024, 3) of the recording's own columns, which begin at the connector, behind."""
    return np.roll(beam_directions(sensor("OS1-128"), COLUMNS), COLUMNS // 2, axis=1)


def read_recording(folder: Path) -> Recording:
    """Profile RNG15_RFL8_NIR8: 16 columns a packet, 4 bytes a pixel, range in 8 mm."""
    metadata = json.loads((folder / f"{NAME}.json").read_text())
    raw = (folder / f"{NAME}_lb_n3.pcap").read_bytes()
    header, footer, per_packet, column_bytes = 32, 32, 16, 12 + 4 * ROWS
    scans: dict[int, np.ndarray] = {}
    at = 24
    while at < len(raw):
        size = struct.unpack_from("<I", raw, at + 8)[0]
        payload = raw[at + 16 + 42 : at + 16 + size]  # past Ethernet, IPv4 and UDP
        at += 16 + size
        if len(payload) != header + per_packet * column_bytes + footer:
            continue  # of the inertial sensor
        scan = scans.setdefault(
            struct.unpack_from("<H", payload, 2)[0], np.zeros((2, ROWS, COLUMNS))
        )
        for number in range(per_packet):
            start = header + number * column_bytes
            column, status = struct.unpack_from("<8xHH", payload, start)
            if status & 1:
                pixel = np.frombuffer(payload, "<u4", ROWS, start + 12)
                scan[:, :, column] = (pixel & 0x7FFF) * STEP_M, pixel >> 16 & 0xFF
    joined = np.array([scans[frame] for frame in sorted(scans)])
    return Recording(joined[:, 0], joined[:, 1], metadata)


def return_model() -> tuple[ReturnModel, float]:
    """The catalogue's OS1-128 in clear air, and strength of a white surface at one metre."""
    vertices = [(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)]
    ground = LabelledMesh.build(
        vertices, [[0, 1, 2], [0, 2, 3]], semantic_id("road"), material_id("asphalt")
    )
    one = {"name": "a", "model": "OS1-128", "east_m": 0.0, "north_m": 0.0, "height_m": 2.0}
    rig = place_rig(RigSpec.model_validate({"sensors": [one]}), ground)
    return ReturnModel(rig.sensors[0]), 45.0**2 / 0.1


# --- where surfaces are ---------------------------------------------------------------------


@dataclass(frozen=True)
class Surfaces:
    """Of pixels on surfaces (P,): what their surroundings say, and what they did themselves."""

    range_m: np.ndarray
    amplitude: np.ndarray
    missing: np.ndarray
    ground: np.ndarray
    cosine: np.ndarray
    reflectivity: np.ndarray
    even: np.ndarray


def surfaces(recording: Recording) -> Surfaces:
    r, f = recording.range_m, recording.reflectivity
    left, right = (_nearest_return(r, f, turn) for turn in (1, -1))
    both = (left[0] > 0) & (right[0] > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        both &= np.abs(np.log(left[0] / right[0])) < AGREE
        # Linear in 1/range between the two.
        share = left[2] / (left[2] + right[2])
        expected = 1 / (share / right[0] + (1 - share) / left[0])
        elsewhere = (r > 0) & (np.abs(np.log(r / expected)) > AGREE)
    # Retroreflectors are no reflectivity; and what is on the sensor's own vehicle is no scene.
    on = both & ~elsewhere & (left[1] <= 100) & (right[1] <= 100) & (expected > 4.0)
    where = np.nonzero(on)
    plane = ground_plane(recording)
    aim = directions()[where[1], where[2]]
    place = aim * expected[on][:, None]
    high = place @ plane[:3] - plane[3]
    near = np.abs(high) < 0.03 + 0.015 * expected[on]
    return Surfaces(
        expected[on],
        (left[1][on] + right[1][on]) / 200,
        r[on] == 0,
        near,
        -(aim @ plane[:3]),
        f[on],
        _even(recording, expected, left[1], right[1])[on],
    )


def _even(
    recording: Recording, expected: np.ndarray, left: np.ndarray, right: np.ndarray
) -> np.ndarray:
    """Whether the pixels above and below return from there too, all four about as bright."""
    r, f = recording.range_m, recording.reflectivity
    shift = recording.metadata["data_format"]["pixel_shift_by_row"]
    even = np.abs(np.log((left + 0.5) / (right + 0.5))) < EVEN
    for other in (-1, 1):
        for row in range(ROWS):
            if not 0 <= row + other < ROWS:
                even[:, row] = False
                continue
            aside = shift[row + other] - shift[row]
            range_m = np.roll(r[:, row + other], aside, 1)
            bright = np.roll(f[:, row + other], aside, 1)
            with np.errstate(divide="ignore", invalid="ignore"):
                even[:, row] &= np.abs(np.log(range_m / expected[:, row])) < AGREE
            even[:, row] &= np.abs(np.log((bright + 0.5) / (left[:, row] + 0.5))) < EVEN
    return even


def _nearest_return(r: np.ndarray, f: np.ndarray, turn: int) -> tuple[np.ndarray, ...]:
    """Range, reflectivity and distance in columns of the nearest return on one side."""
    found = [np.zeros_like(r) for _ in range(3)]
    for step in range(1, REACH + 1):
        other = np.roll(r, turn * step, axis=2)
        new = (found[0] == 0) & (other > 0)
        found[0][new] = other[new]
        found[1][new] = np.roll(f, turn * step, axis=2)[new]
        found[2][new] = step
    return tuple(found)


def ground_plane(recording: Recording) -> np.ndarray:
    """Unit normal and offset of the road around the sensor, by repeated least squares."""
    points = recording.points()[recording.range_m > 0]
    flat = np.hypot(points[:, 0], points[:, 1])
    points = points[(flat > 4) & (flat < 12) & (points[:, 2] < -1.2)]
    rows = np.column_stack([points[:, :2], np.ones(len(points))])
    kept = np.ones(len(points), bool)
    for _ in range(20):
        slope = np.linalg.lstsq(rows[kept], points[kept, 2], rcond=None)[0]
        kept = np.abs(points[:, 2] - rows @ slope) < 0.06
    normal = np.array([-slope[0], -slope[1], 1.0])
    return np.array([*normal, slope[2]]) / np.linalg.norm(normal)


# --- what is measured -----------------------------------------------------------------------


def beam_error_deg(recording: Recording) -> float:
    """Largest angle between a beam of the packets' metadata and of the catalogue."""
    meta = recording.metadata
    theta = 2 * np.pi * (1 - np.arange(COLUMNS) / COLUMNS)
    phi = theta - np.radians(meta["beam_azimuth_angles"])[:, None]
    up = np.radians(meta["beam_altitude_angles"])[:, None]
    lidar = np.stack(
        [np.cos(phi) * np.cos(up), np.sin(phi) * np.cos(up), np.sin(up) + 0 * phi], axis=-1
    )
    turn = np.array(meta["lidar_to_sensor_transform"]).reshape(4, 4)[:3, :3]
    apart = np.linalg.norm(lidar @ turn.T - directions(), axis=-1)
    return float(np.degrees(2 * np.arcsin(apart / 2)).max())


def dropout(found: Surfaces, by: str) -> list[dict]:
    """Share of missing pixels on surfaces, real and simulated, by range or by strength."""
    model, white = return_model()
    amplitude, range_m = (a.astype(np.float32) for a in (found.amplitude, found.range_m))
    # The surroundings tell how bright a pixel is but for the texture.
    median = amplitude * np.exp(-(model.scatter.texture**2) / 2)
    peak = np.where(found.ground, model.peak_left(range_m, np.maximum(found.cosine, 0.01)), 1)
    peak = peak.astype(np.float32)
    expected = 1 - model.detection_among(median, range_m, model.scatter.texture, peak)
    strength = white * found.amplitude / found.range_m**2
    value, edges = (found.range_m, RANGES_M) if by == "range_m" else (strength, STRENGTHS)
    rows = []
    # Farther than that, what lies near the plane is no longer road.
    ground = found.ground & (found.range_m < 30)
    kinds = (("ground", ground), ("other", ~found.ground), ("even", ~found.ground & found.even))
    for kind, chosen in kinds:
        # Below the overlap the reported reflectivity is none.
        counted = chosen & (found.range_m > (0 if by == "range_m" else OVERLAP_M))
        for low, high in itertools.pairwise(edges):
            here = counted & (value >= low) & (value < high)
            if here.sum() >= 100:
                rows.append(
                    {
                        "surface": kind,
                        by: [low, high],
                        "pixels": int(here.sum()),
                        "median_strength": float(np.median(strength[here])),
                        "real": float(found.missing[here].mean()),
                        "simulated": float(expected[here].mean()),
                    }
                )
    return rows


def range_noise(recording: Recording, seed: int = 0) -> list[dict]:
    """Standard deviation about a parabola in 1/range on planes, millimetres: quartile and median.

    A window lies on a plane where those four rows up and down, which look the same way, are in
    line with it: its mean, and its slope. Its own scatter plays no part in that. Stone, bricks
    and frames remain: the best quartile is nearest to what the sensor itself adds.
    """
    model, _ = return_model()
    plane = ground_plane(recording)
    x = np.arange(WINDOW) - WINDOW // 2
    terms = np.vander(x, 3)
    smooth = terms @ np.linalg.pinv(terms)
    starts = np.arange(0, COLUMNS - WINDOW, WINDOW)
    index = starts[:, None] + np.arange(WINDOW)
    r, f = recording.range_m[:, :, index], recording.reflectivity[:, :, index]
    middle = r[..., WINDOW // 2]
    inverse = np.divide(1.0, r, out=np.full(r.shape, np.nan), where=r > 0)
    mean, slope = inverse.mean(axis=-1), inverse @ x / (x @ x)
    off = np.full(mean.shape, np.inf)
    up, here, down = np.s_[:, :-8], np.s_[:, 4:-4], np.s_[:, 8:]
    bend = np.abs(mean[up] + mean[down] - 2 * mean[here]) / 2
    turn = np.maximum(np.abs(slope[up] - slope[here]), np.abs(slope[down] - slope[here]))
    off[here] = np.maximum(bend, turn * WINDOW / 2) * middle[here] ** 2
    high = (directions()[:, starts + WINDOW // 2] @ plane[:3]) * middle - plane[3]
    ground = np.abs(high) < 0.03 + 0.015 * middle
    whole = (f <= 100).all(axis=-1) & (middle > 4) & (np.ptp(r, axis=-1) < 0.1 * middle)
    # The road far off is seen by too few rows to tell planes.
    whole &= (off < 0.01 + 0.002 * middle) | (ground & np.isfinite(mean))
    r, f, ground = r[whole], f[whole], ground[whole]

    def spread(ranges: np.ndarray) -> np.ndarray:
        left = -(ranges**2) * (1 / ranges - (1 / ranges) @ smooth.T)
        return np.sqrt((left**2).sum(axis=1) / (WINDOW - 3)) * 1000

    truth = 1 / ((1 / r) @ smooth.T)
    amplitude = np.repeat(f.mean(axis=1, keepdims=True) / 100, WINDOW, axis=1).astype(np.float32)
    sigma = model.sigma(amplitude.ravel(), truth.astype(np.float32).ravel()).reshape(truth.shape)
    noise = np.random.default_rng(seed).integers(0, 65536, truth.size, np.uint16)
    simulated = truth + sigma * standard_noise(noise).reshape(truth.shape)
    simulated = np.rint(simulated / STEP_M) * STEP_M
    real_mm, simulated_mm = spread(r), spread(simulated)
    centre = r[:, WINDOW // 2]
    rows = []
    for kind, chosen in (("ground", ground), ("other", ~ground)):
        for low, high in itertools.pairwise(RANGES_M):
            inside = chosen & (centre >= low) & (centre < high)
            if inside.sum() >= 30:
                rows.append(
                    {
                        "surface": kind,
                        "range_m": [low, high],
                        "windows": int(inside.sum()),
                        "real_mm": np.percentile(real_mm[inside], [25, 50]).tolist(),
                        "simulated_mm": np.percentile(simulated_mm[inside], [25, 50]).tolist(),
                    }
                )
    return rows


def asphalt(found: Surfaces) -> list[dict]:
    """Reflectivity reported of the road against what the material's law says, per cosine."""
    law = scatter_of_materials(sensor("OS1-128").assumed_wavelength_nm)
    rows = []
    edges = (0.055, 0.07, 0.085, 0.1, 0.12, 0.14, 0.17, 0.2, 0.23)
    seen = found.ground & ~found.missing & (found.range_m > OVERLAP_M)
    for low, high in itertools.pairwise(edges):
        here = seen & (found.cosine >= low) & (found.cosine < high)
        if here.sum() < 100:
            continue
        middle = np.array([np.median(found.cosine[here])], np.float32)
        material = np.array([material_id("asphalt")], np.uint8)
        rows.append(
            {
                "cosine": float(middle[0]),
                "range_m": float(np.median(found.range_m[here])),
                "pixels": int(here.sum()),
                "real": float(np.median(found.reflectivity[here]) / 100),
                "simulated": float(law.backscatter(material, middle)[0]),
            }
        )
    return rows


def road_missing(recording: Recording) -> list[dict]:
    """Share of rays at the open road that find nothing, by range, against the material's law.

    A ray without a return looks at open road where the next return below it is of the road, and
    the next one above it is farther than the road would be. Unlike `dropout`, the simulated side
    knows nothing of what the real sensor reported: asphalt, the plane's range and angle, that is
    all. Real road is not all asphalt, nor a plane.
    """
    model, _ = return_model()
    plane = ground_plane(recording)
    shift = recording.metadata["data_format"]["pixel_shift_by_row"]
    aim = directions()
    slope = aim @ plane[:3]
    expected = np.where(slope < -0.02, plane[3] / np.minimum(slope, -0.02), np.inf)
    where = []
    for r in recording.range_m:
        high = r * slope - plane[3]
        road = (r > 0) & (np.abs(high) < 0.03 + 0.015 * r)
        rows = [
            np.roll(np.stack([r, road, expected, -slope])[:, n], k, 1) for n, k in enumerate(shift)
        ]
        ranges, is_road, ahead, cosine = np.stack(rows, axis=1)
        above = np.zeros(COLUMNS)
        beyond = np.zeros((ROWS, COLUMNS))
        for row in range(ROWS):  # from the sky down
            beyond[row] = above
            above = np.where(ranges[row] > 0, ranges[row], above)
        below = np.zeros(COLUMNS, bool)
        stands_on_road = np.zeros((ROWS, COLUMNS), bool)
        for row in reversed(range(ROWS)):
            stands_on_road[row] = below
            below = np.where(ranges[row] > 0, is_road[row] > 0, below)
        missing = (ranges == 0) & stands_on_road & (beyond > ahead)
        counted = (is_road > 0) | missing
        where.append(np.column_stack([ahead[counted], missing[counted], cosine[counted]]))
    ahead, missing, cosine = np.concatenate(where).T
    law = scatter_of_materials(sensor("OS1-128").assumed_wavelength_nm)
    material = np.full(len(ahead), material_id("asphalt"), np.uint8)
    amplitude = law.backscatter(material, cosine).astype(np.float32)
    # Frames have texture and patches; mean and median of the first differ.
    median = amplitude * np.exp(-(model.scatter.texture**2) / 2)
    peak = model.peak_left(ahead, cosine)
    ours = 1 - model.detection_among(median, ahead, model.scatter.ground_spread, peak)
    found = []
    for low, high in itertools.pairwise(RANGES_M):
        here = (ahead >= low) & (ahead < high)
        if here.sum() >= 100:
            found.append(
                {
                    "range_m": [low, high],
                    "rays": int(here.sum()),
                    "cosine": float(np.median(cosine[here])),
                    "real": float(missing[here].mean()),
                    "simulated": float(ours[here].mean()),
                }
            )
    return found


def measure(folder: Path) -> dict:
    recording = read_recording(folder)
    found = surfaces(recording)
    return {
        "scans": len(recording.range_m),
        "returns": [int((scan > 0).sum()) for scan in recording.range_m],
        "beam_error_deg": beam_error_deg(recording),
        "dropout_by_range": dropout(found, "range_m"),
        "range_noise": range_noise(recording),
        "asphalt": asphalt(found),
        "road_missing": road_missing(recording),
    }
