"""The motion folder: what is saved is what is read, and nothing else is."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.roads import SignalHead
from urbantwin.traffic import Motion, describe
from urbantwin.traffic.assets import asset_mesh
from urbantwin.traffic.fingerprint import table_sha256
from urbantwin.traffic.motion import ACTOR_SCHEMA, MOTION_VERSION
from urbantwin.traffic.motion_rows import RowsInFile
from urbantwin.traffic.signals import SIGNAL_SCHEMA, signal_table


def actor(time_s: float, track: int, kind: str = "car") -> dict[str, object]:
    numbers = dict.fromkeys(("x", "y", "z", "yaw", "pitch", "roll", "speed"), 0.25)
    size = {"length": 4.0, "width": 1.8, "height": 1.5}
    return {
        "time_s": time_s, "track": track, "class": kind, "asset": f"{kind}-x", "phase": 0,
        **numbers, **size, "lane": ":a_long_lane_0",
    }  # fmt: skip


@pytest.fixture
def motion() -> Motion:
    rows = [actor(0.0, 1), actor(0.0, 2, "bus"), actor(0.3, 2, "bus"), actor(0.3, 7)]
    head = SignalHead("p", (0, 1), "lane", 3.0, 4.0, 0.0)
    manifest = {
        "kind": "motion", "version": MOTION_VERSION, "seed": 4, "step_s": 0.1, "steps": 4,
        "twin_sha256": "ab" * 32,
        "duration_s": 0.4, "left_out": [], "teleports": 0, "collisions": 0,
    }  # fmt: skip
    return Motion(
        manifest,
        pa.Table.from_pylist(rows, ACTOR_SCHEMA),
        signal_table([(-5, "p", "rG"), (2, "p", "Gy")], [head], steps=4, step_s=0.1),
    )


def test_a_motion_comes_back_as_it_was(motion: Motion, tmp_path: Path) -> None:
    motion.save(tmp_path / "m")
    again = Motion.load(tmp_path / "m")
    assert again.manifest == motion.manifest
    assert again.actors.equals(motion.actors)
    assert again.signals.equals(motion.signals)
    assert again.sha256() == motion.sha256()
    assert pq.read_schema(tmp_path / "m" / "actors.parquet").equals(ACTOR_SCHEMA)
    assert sorted(path.name for path in (tmp_path / "m").iterdir()) == [
        "SHA256SUMS",
        "actors.parquet",
        "meshes.npz",
        "motion.json",
        "signals.parquet",
    ]


def test_a_motion_keeps_the_meshes_of_its_actors(motion: Motion, tmp_path: Path) -> None:
    box = LabelledMesh.build([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], 10, 12)
    own = replace(motion, meshes={("my-car", 3): box})
    own.save(tmp_path / "m")
    again = Motion.load(tmp_path / "m")
    assert list(again.meshes) == [("my-car", 3)]
    for name in ("vertices", "faces", "semantic", "material", "part"):
        np.testing.assert_array_equal(getattr(again.mesh("my-car", 3), name), getattr(box, name))
    assert again.sha256() == own.sha256() != motion.sha256()
    # What the motion does not have comes from the catalogue.
    assert again.mesh("car-sedan", 0) is asset_mesh("car-sedan", 0)
    (tmp_path / "m" / "meshes.npz").write_bytes(b"PK")
    with pytest.raises(InputError, match=r"meshes\.npz: is not readable"):
        Motion.load(tmp_path / "m")


def test_a_change_of_one_number_changes_the_hash(motion: Motion) -> None:
    x = motion.actors["x"].to_numpy().copy()
    x[2] += 1e-9
    moved = motion.actors.set_column(5, "x", pa.array(x))
    assert Motion(motion.manifest, moved, motion.signals).sha256() != motion.sha256()


def test_one_step_at_a_time(motion: Motion) -> None:
    np.testing.assert_array_equal(motion.times(), [0.0, 0.1, 0.2, 0.3])
    rows = motion.at(0.1 + 0.2)
    assert rows.dtype.names == tuple(ACTOR_SCHEMA.names)
    assert list(rows["track"]) == [2, 7]
    assert [row["class"] for row in rows] == ["bus", "car"]
    assert rows[0]["lane"] == ":a_long_lane_0"
    assert len(motion.at(0.1)) == 0


@pytest.mark.parametrize("time_s", [0.05, -0.1, 0.4])
def test_a_time_between_or_beyond_the_steps_is_refused(motion: Motion, time_s: float) -> None:
    with pytest.raises(InputError, match="no step"):
        motion.at(time_s)


def test_signals_start_with_everything_and_go_on_with_changes(motion: Motion) -> None:
    rows = motion.signals.to_pylist()
    seen = [(row["time_s"], row["link"], row["state"]) for row in rows]
    assert seen == [(0.0, 0, "r"), (0.0, 1, "G"), (0.2, 0, "G"), (0.2, 1, "y")]
    assert {(row["x"], row["y"]) for row in rows} == {(3.0, 4.0)}


def test_a_description_counts_actors(motion: Motion, tmp_path: Path) -> None:
    motion.save(tmp_path / "m")
    described = describe(tmp_path / "m")
    assert described["actors"] == {"bus": 1, "car": 2}
    assert described["poses"] == 4
    assert described["signal_links"] == 2
    json.dumps(described)


@pytest.fixture
def crowd() -> pa.Table:
    """Forty steps, of 0 to 12 actors each, every fifth without anybody."""
    counts = [0 if n % 5 == 4 else 3 * (n % 5) + n % 4 for n in range(40)]
    return pa.Table.from_pylist(
        [
            {**actor(round(n * 0.1, 9), k, ("car", "bus")[k % 2]), "x": n + k / 100, "phase": n % 3}
            for n, count in enumerate(counts)
            for k in range(count)
        ],
        ACTOR_SCHEMA,
    )


def test_rows_in_a_file_are_those_in_memory(crowd: pa.Table, tmp_path: Path) -> None:
    """Groups of seven rows, so that steps lie in two of them."""
    pq.write_table(crowd, tmp_path / "a.parquet", row_group_size=7)
    rows = RowsInFile(tmp_path / "a.parquet")
    assert rows.num_rows == crowd.num_rows > 100
    assert rows.table().equals(crowd)
    assert rows.table(["lane", "x"]).equals(crowd.select(["lane", "x"]))
    parts = list(rows.parts(["x", "track"]))
    assert len(parts) > 10
    assert pa.concat_tables(parts).combine_chunks().equals(crowd.select(["x", "track"]))
    steps = [set(part["time_s"].to_pylist()) for part in rows.parts()]
    assert sum(map(len, steps)) == len(set.union(*steps))  # each in one part
    times = crowd["time_s"].to_numpy()
    for first, last in ((0.0, 0.35), (0.4, 0.4), (1.1, 2.6), (3.8, 9.0)):
        there = crowd.filter(pa.array((times >= first) & (times <= last)))
        assert rows.between(first, last).combine_chunks().equals(there)
    assert (
        rows.where("track", [2, 5])
        .combine_chunks()
        .equals(crowd.filter(pc.is_in(crowd["track"], pa.array([2, 5], pa.int32()))))
    )
    told = {tuple(row.values()) for row in crowd.select(["class", "phase"]).to_pylist()}
    found = rows.distinct(["class", "phase"]).to_pylist()
    assert {tuple(row.values()) for row in found} == told
    assert len(found) == len(told)


def test_a_motion_is_the_same_from_a_file(crowd: pa.Table, motion: Motion, tmp_path: Path) -> None:
    pq.write_table(crowd, tmp_path / "a.parquet", row_group_size=7)
    manifest = {**motion.manifest, "steps": 40}
    whole = Motion(manifest, crowd, motion.signals)
    parts = Motion(manifest, RowsInFile(tmp_path / "a.parquet"), motion.signals)
    assert parts.sha256() == whole.sha256()
    assert table_sha256(parts.rows) == table_sha256(crowd)
    for time_s in whole.times():
        np.testing.assert_array_equal(parts.at(time_s), whole.at(time_s))
    parts.save(tmp_path / "m")
    whole.save(tmp_path / "n")
    one, other = ((tmp_path / name / "actors.parquet").read_bytes() for name in "mn")
    assert one == other
    assert Motion.load(tmp_path / "m").actors.equals(crowd)


def spoil_kind(folder: Path) -> None:
    (folder / "motion.json").write_text('{"kind": "twin"}')


def spoil_version(folder: Path) -> None:
    text = (folder / "motion.json").read_text()
    (folder / "motion.json").write_text(text.replace('"version": 1', '"version": 99'))


def spoil_table(folder: Path) -> None:
    (folder / "actors.parquet").write_bytes(b"PAR1 and then nothing")


def drop_table(folder: Path) -> None:
    (folder / "signals.parquet").unlink()


def rename_column(folder: Path) -> None:
    table = pq.read_table(folder / "actors.parquet")
    pq.write_table(table.rename_columns({"yaw": "heading"}), folder / "actors.parquet")


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (spoil_kind, "motion.json"),
        (spoil_version, "motion.json"),
        (spoil_table, "actors.parquet"),
        (drop_table, "signals.parquet"),
        (rename_column, "actors.parquet"),
    ],
)
def test_what_is_not_a_motion_is_refused_by_name(motion, tmp_path, spoil, named) -> None:
    motion.save(tmp_path / "m")
    spoil(tmp_path / "m")
    with pytest.raises(InputError) as caught:
        Motion.load(tmp_path / "m")
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not found"):
        Motion.load(tmp_path / "nothing")


def test_schemas_are_those_of_the_document() -> None:
    text = (Path(__file__).parents[2] / "docs" / "architecture.md").read_text()
    for name in (*ACTOR_SCHEMA.names, *SIGNAL_SCHEMA.names):
        assert f"`{name}`" in text
