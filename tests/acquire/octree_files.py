"""Surveys as COPC (https://copc.io) and as EPT, which no library here writes."""

import io
import json
import struct
from collections import defaultdict

import laspy
import lazrs
import numpy as np
from pyproj import CRS

#: Of a point record of format 6.
FORMAT, RECORD = 6, 30
DEPTH = 3


def octree(points: np.ndarray) -> tuple[np.ndarray, float, dict[tuple, np.ndarray]]:
    """The cube, and which points the nodes (depth, x, y, z) hold: each is in one."""
    low = np.floor(points.min(axis=0))
    side = float(np.ceil((points.max(axis=0) - low).max())) + 1.0
    level = np.minimum(np.arange(len(points)) % 9, DEPTH)  # a ninth each above the leaves
    nodes = defaultdict(list)
    for depth in range(DEPTH + 1):
        rows = np.flatnonzero(level == depth)
        cells = np.floor((points[rows] - low) / side * 2**depth).astype(int)
        for row, cell in zip(rows, cells, strict=True):
            nodes[(depth, *cell.tolist())].append(row)
            for up in range(depth):  # nodes above exist, be they empty
                nodes[(up, *(cell >> (depth - up)).tolist())] += []
    return low, side, {key: np.array(rows, int) for key, rows in sorted(nodes.items())}


def as_copc(points: np.ndarray, classes: np.ndarray, crs: CRS) -> bytes:
    """(N, 3) points with their classes as one COPC file; its hierarchy has two pages."""
    low, side, nodes = octree(points)
    scale = 0.001
    header = laspy.LasHeader(point_format=FORMAT, version="1.4")
    header.scales, header.offsets = np.full(3, scale), low
    record = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
    record.x, record.y, record.z = points.T
    record.classification = classes
    record.return_number[:] = record.number_of_returns[:] = 1
    lazvlr = lazrs.LazVlr.new_for_compression(FORMAT, 0, True)
    wkt = crs.to_wkt("WKT1_GDAL").encode() + b"\0"
    vlrs = [(b"copc", 1, bytes(160)), (b"laszip encoded", 22204, bytes(lazvlr.record_data())),
            (b"LASF_Projection", 2112, wkt)]  # fmt: skip
    start = 375 + sum(54 + len(data) for *_, data in vlrs)
    out = io.BytesIO(bytes(start))
    out.seek(start)
    machine = lazrs.LasZipCompressor(out, lazvlr)
    entries, at = {}, start + 8
    for key, rows in nodes.items():
        if not len(rows):
            entries[key] = (0, 0, 0)
            continue
        machine.compress_many(np.frombuffer(record.array[rows].tobytes(), np.uint8))
        machine.finish_current_chunk()
        entries[key] = (at, out.tell() - at, len(rows))
        at = out.tell()
    machine.done()
    out.seek(0, io.SEEK_END)
    evlr = out.tell()
    deep = [key for key in entries if key[0] == DEPTH]
    page = b"".join(struct.pack("<iiii", *key) + struct.pack("<Qii", *entries[key]) for key in deep)
    # Leaves stand in a page of their own, to which an entry for each leads.
    rows = {key: entry for key, entry in entries.items() if key[0] < DEPTH}
    pages_at = evlr + 60
    pointers = {key: (pages_at, len(page), -1) for key in deep}
    root = b"".join(struct.pack("<iiii", *key) + struct.pack("<Qii", *entry)
                    for key, entry in (rows | pointers).items())  # fmt: skip
    out.write(struct.pack("<H16sHQ32s", 0, b"copc", 1000, len(page) + len(root), b"hierarchy"))
    out.write(page + root)
    info = struct.pack("<3d2d2Q2d", *(low + side / 2), side / 2, side / 128,
                       pages_at + len(page), len(root), 0.0, 0.0)  # fmt: skip
    vlrs[0] = (b"copc", 1, info.ljust(160, b"\0"))
    out.seek(0)
    high, least = points.max(axis=0), points.min(axis=0)
    out.write(struct.pack(
        "<4sHHIHH8sBB32s32sHHHIIBHI20s", b"LASF", 0, 16, 0, 0, 0, bytes(8), 1, 4, b"tests",
        b"tests", 1, 2026, 375, start, len(vlrs), FORMAT | 0x80, RECORD, 0, bytes(20),
    ))  # fmt: skip
    out.write(struct.pack("<6d", scale, scale, scale, *low))
    out.write(struct.pack("<6d", high[0], least[0], high[1], least[1], high[2], least[2]))
    out.write(struct.pack("<QQIQ", 0, evlr, 1, len(points)) + bytes(15 * 8))
    assert out.tell() == 375
    for user, number, data in vlrs:
        out.write(struct.pack("<H16sHH32s", 0, user, number, len(data), b"") + data)
    assert out.tell() == start
    return out.getvalue()


def as_ept(points: np.ndarray, classes: np.ndarray, crs: CRS) -> dict[str, bytes]:
    """The same as Entwine Point Tiles: files by their names; leaves in hierarchies of their own."""
    low, side, nodes = octree(points)
    files: dict[str, bytes] = {}
    root, below = {}, defaultdict(dict)
    for key, rows in nodes.items():
        name = "-".join(map(str, key))
        if key[0] < DEPTH:
            root[name] = len(rows)
        else:
            root[name] = -1
            below[name][name] = len(rows)
        if not len(rows):
            continue
        header = laspy.LasHeader(point_format=1, version="1.2")
        header.scales, header.offsets = np.full(3, 0.01), low
        cloud = laspy.LasData(header)
        cloud.x, cloud.y, cloud.z = points[rows].T
        cloud.classification = classes[rows]
        cloud.return_number[:] = cloud.number_of_returns[:] = 1
        packed = io.BytesIO()
        cloud.write(packed, do_compress=True)
        files[f"ept-data/{name}.laz"] = packed.getvalue()
    files["ept-hierarchy/0-0-0-0.json"] = json.dumps(root).encode()
    files |= {f"ept-hierarchy/{name}.json": json.dumps(one).encode() for name, one in below.items()}
    horizontal, vertical = (str(one.to_epsg()) for one in crs.sub_crs_list)
    about = {
        "bounds": [*low.tolist(), *(low + side).tolist()],
        "dataType": "laszip", "hierarchyType": "json", "points": len(points), "span": 128,
        "srs": {"authority": "EPSG", "horizontal": horizontal, "vertical": vertical},
        "version": "1.0.0",
    }  # fmt: skip
    return files | {"ept.json": json.dumps(about).encode()}
