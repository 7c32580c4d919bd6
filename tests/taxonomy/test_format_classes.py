"""Classes of other formats: every class of ours has a row, and labels are SemanticKITTI's."""

from importlib.util import find_spec

import pytest

from urbantwin.exports.frames import DATASET_FORMATS
from urbantwin.taxonomy import BOX_SEMANTICS, classes_in, kitti_labels, semantic_classes
from urbantwin.taxonomy.semantic import table_rows

#: What names boxes and points as we do.
OURS = {"pcd", "las", "laz", "mcap", "parquet", "webdataset"}
#: Not a format of ``--to`` but the standard's own codes within one.
CODES = {"las1.4"}
ROWS = table_rows("format_classes.csv")
WITH_BOXES = [
    name
    for name, one in DATASET_FORMATS.items()
    if name not in OURS and "boxes" in one.holds and find_spec(f"urbantwin.exports.frames.{name}")
]


@pytest.mark.parametrize(("format_name", "of"), sorted({(r["format"], r["of"]) for r in ROWS}))
def test_every_class_has_one_row_in_its_place(format_name, of):
    found = [row["ours"] for row in ROWS if (row["format"], row["of"]) == (format_name, of)]
    assert found == list(BOX_SEMANTICS if of == "box" else semantic_classes())
    assert format_name in CODES or format_name in DATASET_FORMATS


@pytest.mark.parametrize("format_name", WITH_BOXES)
def test_every_format_with_boxes_says_what_it_calls_them(format_name):
    assert {"openpcdet", "mmdet3d", "kitti"} <= set(WITH_BOXES)
    assert list(classes_in(format_name)) == list(BOX_SEMANTICS)


def test_points_are_called_as_semantickitti_has_them():
    # Behley et al. 2019, table of classes: our numbers are theirs.
    labels = kitti_labels()
    for ours, theirs in classes_in("semantickitti", "point").items():
        assert labels[theirs].id == semantic_classes()[ours].id
    assert len(labels) == 34
    assert [one.id for one in labels.values()] == sorted(one.id for one in labels.values())
    moving = [name for name in labels if name.startswith("moving-")]
    assert [labels[name].id for name in moving] == list(range(252, 260))
    assert sorted({one.learned for one in labels.values()}) == list(range(20))


def test_a_format_without_classes_has_none():
    assert classes_in("none") == {}
    assert classes_in("kitti", "point") == {}
