"""Every class has a row in the table of classes; rows that no exporter can take are refused."""

import shutil

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from urbantwin.errors import InputError
from urbantwin.exports.frames import DATASET_FORMATS, export_dataset
from urbantwin.exports.frames.lumpi import CLASSES
from urbantwin.exports.frames.nuscenes_names import CATEGORIES
from urbantwin.fidelity.readers.labels import actor_class
from urbantwin.taxonomy import BOX_SEMANTICS, classes_in, semantic_classes

FORMATS = ("nuscenes", "openlabel", "opv2v", "lumpi")


@pytest.mark.parametrize("name", FORMATS)
def test_every_class_has_a_row_and_reads_back_as_its_like(name):
    rows = classes_in(name)
    assert list(rows) == list(BOX_SEMANTICS)
    like = {"van": {"van", "car"}, "trailer": {"trailer", "truck"}}
    for ours, theirs in rows.items():
        if theirs is not None:
            assert actor_class(theirs) in {ours, "other"} | like.get(ours, set())
    if "semantic" in DATASET_FORMATS[name].holds and classes_in(name, "point"):
        assert list(classes_in(name, "point")) == list(semantic_classes())


def test_names_are_those_that_the_formats_have():
    named = {*classes_in("nuscenes").values(), *classes_in("nuscenes", "point").values()} - {None}
    assert named <= set(CATEGORIES)
    assert set(classes_in("lumpi").values()) <= set(CLASSES)


def damaged(dataset, tmp_path, change):
    out = tmp_path / "damaged"
    shutil.copytree(dataset, out)
    file = out / "boxes.parquet"
    table = pq.read_table(file)
    rows = table.to_pylist()
    change(rows)
    pq.write_table(pa.Table.from_pylist(rows, table.schema), file)
    return out


@pytest.mark.parametrize("to", FORMATS)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda rows: rows.append(dict(rows[-1])),
            r"boxes\.parquet: track: has the track \d+ twice",
        ),
        (lambda rows: rows[-1].update({"class": "spaceship"}), r"class: has the class 'spaceship'"),
        (lambda rows: rows[-1].update({"x": float("nan")}), r"boxes\.parquet: x.* not finite"),
    ],
)
def test_bad_rows_are_told_in_a_line(dataset, tmp_path, to, change, words):
    with pytest.raises(InputError, match=words) as raised:
        export_dataset(damaged(dataset, tmp_path, change), to, tmp_path / "out")
    assert "\n" not in str(raised.value)
    assert not (tmp_path / "out").exists()
