"""A recording for rerun, read again by rerun's own reader."""

import numpy as np
import pyarrow.parquet as pq
import pytest

import urbantwin as ut


def test_it_holds_the_points_and_boxes_of_every_frame(dataset, tmp_path):
    chunks = pytest.importorskip("rerun.chunk")
    path = tmp_path / "frames.rrd"
    made = ut.view(dataset, rerun=path, frames="0:3", progress=False)
    assert (made.rerun, made.address) == (path, None)
    found = {}
    for chunk in chunks.RrdReader(path).stream():
        batch = chunk.to_record_batch()
        for kind, name in (("points", "Points3D:positions"), ("boxes", "Boxes3D:half_sizes")):
            if chunk.entity_path == f"/frame/{kind}":
                for frame, values in zip(
                    batch["frame"].to_pylist(), batch[name].to_pylist(), strict=True
                ):
                    found[kind, frame] = np.array(values)
    assert set(found) == {(kind, frame) for kind in ("points", "boxes") for frame in range(3)}
    rows = pq.read_table(dataset / "boxes.parquet").to_pylist()
    for frame in range(3):
        points = np.load(dataset / "points" / f"{frame:06d}.npy")
        assert len(found["points", frame]) == len(points)
        sensor = found["points", frame].mean(axis=0)  # turned and moved, but as large as it was
        spread = np.linalg.norm(found["points", frame] - sensor, axis=1)
        wanted = np.linalg.norm(points[:, :3] - points[:, :3].mean(axis=0), axis=1)
        assert np.allclose(spread, wanted, atol=1e-3)
        mine = [row for row in rows if row["frame"] == f"{frame:06d}"]
        sizes = [[row["length"] / 2, row["width"] / 2, row["height"] / 2] for row in mine]
        assert np.allclose(found["boxes", frame], sizes, atol=1e-4)
