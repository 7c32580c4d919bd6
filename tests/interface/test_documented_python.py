"""The examples of the documents, executed from the first block to the last."""

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ..reliability.small_site import ROOT
from .conftest import Line

_BLOCK = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)
#: Blocks of a document that another test runs: the notebook builds, drives, records and compares.
_ELSEWHERE = {"docs/guide/dataset.md": 1, "docs/reference/python.md": 0, "README.md": 0}


def blocks_of(document: str) -> list[str]:
    return _BLOCK.findall((ROOT / document).read_text())


@pytest.mark.parametrize("document", _ELSEWHERE)
def test_the_examples_run(
    line: Line, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, document: str
) -> None:
    if document == "docs/guide/dataset.md":
        torch = pytest.importorskip("torch")
        torch.set_num_threads(1)
    monkeypatch.chdir(tmp_path)
    for place in ("out", "rain"):
        shutil.copytree(line.dataset.folder, tmp_path / place / "dataset")
    names: dict[str, Any] = {}
    exec("import urbantwin as ut", names)
    blocks = blocks_of(document)[_ELSEWHERE[document] :]
    assert len(blocks) >= (5 if document == "docs/guide/dataset.md" else 1)
    for number, block in enumerate(blocks):
        exec(compile(block, f"{document}, block {number}", "exec"), names)
    if document == "docs/reference/python.md":
        stored = names["made"].flow(names["frame"].name)
        np.testing.assert_array_equal(stored, names["frame"].flow())
    elif document == "README.md":
        assert names["near"][0].box_array.shape == (len(names["near"][0].boxes), 7)
    else:
        assert len(names["batch"]["points"]) == len(names["batch"]["point_frame"]) > 0
