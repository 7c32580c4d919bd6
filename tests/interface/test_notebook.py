"""The example notebook, cell by cell, as a kernel executes it; on a smaller site."""

import ast
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from ..reliability.small_site import ROOT

NOTEBOOK = ROOT / "examples" / "notebook.ipynb"


def executed(source: str, names: dict[str, Any]) -> Any:
    """Execute a cell; return the value of its last line, which a notebook shows."""
    body = ast.parse(source).body
    last = body.pop() if isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), "cell", "exec"), names)
    return (
        None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    )


@pytest.mark.thorough
def test_the_notebook_runs(site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(
        site.parent, "two-avenues", ignore=lambda folder, names: {"two-avenues"} & {*names}
    )
    document = json.loads(NOTEBOOK.read_text())
    assert document["nbformat"] == 4
    cells = [one for one in document["cells"] if one["cell_type"] == "code"]
    assert not any(one["outputs"] for one in cells)  # nothing of one machine's
    names: dict[str, Any] = {}
    shown = [executed("".join(one["source"]), names) for one in cells]
    figures = [one for one in shown if isinstance(one, Figure)]
    assert len(figures) == 5
    assert all(one._repr_png_().startswith(b"\x89PNG") for one in figures)
    assert bool(shown[-1])  # everything is as it was written
    assert len(names["dataset"]) == 11
    assert names["report"].means["hausdorff_p95_m"]["synthetic"] < 0.5
