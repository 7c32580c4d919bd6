"""A data set is opened in one place, and the columns of its tables are named in one place."""

import ast
from collections.abc import Iterator

from urbantwin.dataset.reading.columns import BOX, POINT, POSE, TABLES, VELOCITY
from urbantwin.dataset.reading.frame_files import FOLDERS

from .source_imports import MODULES, SOURCE

#: Modules that write these folders in other formats, or read those of other formats and artefacts.
OTHER_FORMATS = {
    "evaluation/semantic.py",  # of detections
    "exports/carla/live.py",
    "exports/frames/mmdet3d.py",
    "exports/frames/openpcdet.py",
    "exports/frames/semantickitti.py",
    "fidelity/clouds.py",  # any folder of clouds
    "fidelity/discovery/recording.py",
    "fidelity/readers/own.py",  # folders of OpenPCDet and MMDetection3D, which are laid out alike
    "fidelity/readers/kitti.py",  # of SemanticKITTI
    "reconstruct/recording/recorded_frames.py",  # of discoveries
}
#: Importing one of these opens a file of a frame.
READS_FRAMES = {"read_rays", "read_labels", "read_columns", "read_laz"}


def nodes(words: set[str], *, without: str) -> Iterator[tuple[str, ast.AST]]:
    """Pieces of syntax of the modules that have one of some words, with the module's name.

    Modules whose name begins with ``without`` are left out.
    """
    for module in MODULES:
        name, text = module.relative_to(SOURCE).as_posix(), module.read_text()
        if not name.startswith(without) and any(one in text for one in words):
            for node in ast.walk(ast.parse(text)):
                yield name, node


def test_only_the_reader_opens_the_files_of_a_data_set() -> None:
    tables = {*TABLES, "nodes.parquet"}
    words = {*tables, *READS_FRAMES, *(f'/ "{one}"' for one in FOLDERS)}
    wrong = []
    for name, node in nodes(words, without="dataset/"):
        match node:
            case ast.Constant(value=str(text)) if text in tables:
                wrong.append(f"{name}:{node.lineno}: names {text}")
            case ast.BinOp(op=ast.Div(), right=ast.Constant(value=str(text))):
                if text in FOLDERS and name not in OTHER_FORMATS:
                    wrong.append(f"{name}:{node.lineno}: names the folder {text}")
            case ast.ImportFrom(names=imported):
                opens = READS_FRAMES & {one.name for one in imported}
                if opens and str(node.module).startswith("urbantwin.dataset"):
                    wrong.append(f"{name}:{node.lineno}: imports {', '.join(opens)}")
    assert not wrong, "\n".join(wrong)


def test_columns_are_named_once() -> None:
    groups = {BOX, POSE, POINT, VELOCITY}
    wrong = []
    for name, node in nodes(
        {'"x", "y", "z", ', '"vx", "vy", "vz"'}, without="dataset/reading/columns"
    ):
        if isinstance(node, ast.Tuple | ast.List):
            values = [one.value for one in node.elts if isinstance(one, ast.Constant)]
            if tuple(values) in groups:
                wrong.append(f"{name}:{node.lineno}: {', '.join(map(str, values))}")
    assert not wrong, "\n".join(wrong)
