"""Where the simulator's numbers come from, as its tables and its code say it.

``python docs/site_build/basis.py`` writes the generated tables of the pages anew (between
``<!-- made: NAME -->`` and ``<!-- end -->``); a test fails when that is due. The site has longer
pages of the same, for every sensor and every constant.
"""

import ast
import csv
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

__all__ = ["PAGES", "Constant", "constants", "kind_of_source", "long_pages", "with_tables"]

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "urbantwin"
#: Pages with generated tables.
PAGES = tuple(
    ROOT / "docs" / name
    for name in ("guide/real_and_guessed.md", "method/materials.md", "reference/sensors.md")
)
#: Packages whose numbers decide what is in a frame, in the order in which it is made.
STAGES = ("site", "ground", "reconstruct", "roads", "scene", "traffic", "lidar")
NOT_AT_HAND = "page not at hand"
MADE = re.compile(r"(<!-- made: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

#: What the words of a comment tell, the first that fits.
_WORDS: tuple[tuple[str, str], ...] = (
    ("as remembered", r"(?i)as remembered|not looked up"),
    ("measured or counted", r"(?i)\bas measured\b|\bmeasured (?:on|of|in) |\bcounted in\b"),
    ("fitted", r"(?i)\b(?:was|were|is|are) fitted to (?:real|roads|cars|frames|recordings)"),
    (
        "estimate",
        r"(?i)\ban estimate\b|\bestimates\b|\bestimated from\b|\bassumed[.)]|\(assumed"
        r"|\bassumption\b|\bwe take\b|\bis taken to be\b"
        r"|rule of thumb|\bare usual\b|\b(?:the|a) usual\b|\busual speed|\btypical\b",
    ),
    (
        "standard, law, paper or maker",
        r"\b(?:EN|ISO|IEC|DIN|HCM|HBS|RASt|RAS|RiLSA|RLS|RMS|VwV|StVO|MUTCD|AASHTO|ASTM|WMO|IES"
        r"|FHWA|DfT|NIST|GALK|UTD|KBA|EPA|OpenDRIVE|ASAM)\b|\b(?:18|19|20)\d\d\b|et al"
        r"|datasheets? (?:give|state|say)|Highway Capacity|OSM wiki"
        r"|netconvert's own|SUMO's own|Goel|by law\b",
    ),
)


def kind_of_source(text: str) -> str:
    """Return which kind of source a text names: a word of the tables below."""
    return next((kind for kind, words in _WORDS if re.search(words, text)), "a choice")


# ---- materials ------------------------------------------------------------------------------


def _rows(path: Path) -> Iterator[dict[str, str]]:
    text = path.read_text(encoding="utf-8")
    lines = (line for line in text.splitlines() if not line.startswith("#"))
    yield from csv.DictReader(lines)


def _table(head: tuple[str, ...], rows: list[tuple[object, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "".join(
        "| " + " | ".join(str(cell).replace("|", r"\|") for cell in line) + " |\n" for line in lines
    )


def _materials() -> str:
    rows = sorted(
        _rows(PACKAGE / "taxonomy" / "material.csv"),
        key=lambda row: (("measured", "modelled", "estimate").index(row["basis"]), int(row["id"])),
    )
    return _table(
        ("material", "865, 905, 1550 nm", "basis", "source, or what was fitted"),
        [
            (
                f"`{row['name']}`",
                ", ".join(row[f"reflectivity_{nm}"] for nm in (865, 905, 1550)),
                row["basis"],
                row["source"],
            )
            for row in rows
        ],
    )


# ---- sensors --------------------------------------------------------------------------------


def _sensors() -> Iterator[tuple[dict[str, Any], dict[str, str]]]:
    """Yield each model's numbers and their sources, by maker and name."""
    files = (PACKAGE / "lidar" / "sensors").glob("*.yaml")
    found = [yaml.safe_load(path.read_text()) for path in files]
    for entry in sorted(found, key=lambda entry: (entry["maker"], entry["name"])):
        yield entry, entry.get("sources", {})


def _sensor_counts() -> str:
    rows: list[tuple[object, ...]] = []
    for entry, sources in _sensors():
        unchecked = sum(NOT_AT_HAND in text for text in sources.values())
        ours = sum(map(_is_ours, sources.values()))
        missing = entry.get("unknown", {})
        assumed = sum(text.startswith("assumed") for text in missing.values())
        rows.append(
            (
                f"{entry['maker']} {entry['name']}",
                len(sources) - unchecked - ours,
                ours,
                unchecked,
                assumed,
                len(missing) - assumed,
            )
        )
    head = ("sensor", "the maker's files and pages", "measured here", "page not at hand",
            "assumed", "not known, or none applies")  # fmt: skip
    return _table(head, rows)


def _is_ours(text: str) -> bool:
    """Return whether the number was found on real scans by us, not stated by the maker."""
    return text.startswith(("measured", "fitted")) or "notebook/real_lidar" in text


def _sensor_page() -> str:
    parts = [
        "# Every number of the sensors\n\nWhat `urbantwin catalogue sensors MODEL` tells of "
        "sources. For a number that is not known [a fallback](sensors.md#fallbacks) is taken."
    ]
    for entry, sources in _sensors():
        told = [(name, "", text) for name, text in sources.items()]
        told += [(name, "*not known* ", text) for name, text in entry.get("unknown", {}).items()]
        rows: list[tuple[object, ...]] = [
            (f"`{name}`", _short(entry.get(name, "a table")), mark + text)
            for name, mark, text in sorted(told)
        ]
        table = _table(("number", "value", "source"), rows)
        parts.append(f"## {entry['maker']} {entry['name']}\n\n{table}")
    return "\n\n".join(parts)


def _short(value: object) -> str:
    text = str(value)
    return f"`{text}`" if len(text) <= 40 else f"`{text[:32]} ...`"


# ---- constants of the code ------------------------------------------------------------------


@dataclass(frozen=True)
class Constant:
    """A number with a name: where it stands, and what its comment says of it."""

    file: str
    name: str
    value: str
    told: str

    @property
    def kind(self) -> str:
        """Which kind of source the comment names."""
        return kind_of_source(self.told)


@cache
def constants(stage: str) -> list[Constant]:
    """Return the numbers of a package that have a name of their own.

    What is told of it stands right above (``#:``) or behind it, or above the first of several, and
    in the sentences of its file's docstring that name it.
    """
    found = []
    for path in sorted((PACKAGE / stage).rglob("*.py")):
        text = path.read_text()
        lines, tree = text.splitlines(), ast.parse(text)
        for node in tree.body:
            match node:
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    pass
                case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
                    pass
                case _:
                    continue
            if not re.fullmatch(r"_?[A-Z][A-Z0-9_]*", name) or not _is_number(value):
                continue
            told = _comment(lines, node.lineno - 1, node.end_lineno or node.lineno)
            told = " ".join([told, *_sentences(ast.get_docstring(tree) or "", name)]).strip()
            source = ast.unparse(value)
            found.append(Constant(path.relative_to(PACKAGE).as_posix(), name, source, told))
    return found


def _sentences(docstring: str, name: str) -> list[str]:
    whole = re.sub(r"\s+", " ", docstring)
    return [one for one in re.split(r"(?<=[.:]) ", whole) if f"`{name}`" in one]


def _is_number(node: ast.expr) -> bool:  # noqa: PLR0911 - a form of an expression each
    """Return whether it is a number, or several in a row or a table."""
    match node:
        case ast.Constant(value=value):
            return isinstance(value, (int, float)) and not isinstance(value, bool)
        case ast.UnaryOp(operand=inner):
            return _is_number(inner)
        case ast.BinOp(left=left, right=right):
            return _is_number(left) and _is_number(right)
        case ast.Tuple(elts=items) | ast.List(elts=items):
            return bool(items) and all(map(_is_number, items))
        case ast.Dict(values=values):
            return bool(values) and all(map(_is_number, values))
        case ast.Call(func=ast.Attribute(attr="radians" | "deg2rad"), args=[inner]):
            return _is_number(inner)
        case _:
            return False


def _comment(lines: list[str], first: int, end: int) -> str:
    above = []
    while first and lines[first - 1].startswith("#"):
        first -= 1
        above.insert(0, lines[first].lstrip("#: "))
    if not above and first and re.match(r"_?[A-Z][A-Z0-9_]* *(:.*)?=", lines[first - 1]):
        # One comment above several numbers is of all of them.
        row = first - 1
        while row and re.match(r"_?[A-Z][A-Z0-9_]* *(:.*)?=", lines[row]):
            row -= 1
        if lines[row].startswith("#"):
            above = [_comment(lines, row + 1, row + 1)]
    behind = lines[end - 1].partition("  # ")[2]
    return " ".join([*above, behind]).strip()


KINDS = (*(kind for kind, _ in _WORDS), "a choice")


def _constant_counts() -> str:
    counted = {stage: Counter(one.kind for one in constants(stage)) for stage in STAGES}
    kinds = [kind for kind in KINDS if any(told[kind] for told in counted.values())]
    rows: list[tuple[object, ...]] = [
        (stage, sum(told.values()), *(told[kind] for kind in kinds))
        for stage, told in counted.items()
    ]
    return _table(("package", "numbers", *kinds), rows)


def _constant_page() -> str:
    parts = [
        "# Every number of the code\n\nNumbers that have a name, in the packages of a frame, "
        "with what the code says of them. The kind is told by the words of the comment: *a choice* "
        "is a number of whoever wrote it (a tolerance, a step, a limit of a method), or one whose "
        "source stands elsewhere in its file."
    ]
    parts.append(_constant_counts())
    for stage in STAGES:
        rows: list[tuple[object, ...]] = [
            (
                f"`{one.file}`",
                f"`{one.name}`",
                _short(one.value),
                one.kind,
                one.told.replace("<", "&lt;"),
            )
            for one in constants(stage)
        ]
        table = _table(("file", "number", "value", "kind", "what the code says"), rows)
        parts.append(f"## {stage}\n\n{table}")
    return "\n\n".join(parts)


# ---- tables of things -----------------------------------------------------------------------


def _things() -> str:
    """Return the table of what is put beside streets where the map is silent, and of trees."""
    kerbside = list(_rows(PACKAGE / "scene" / "clutter" / "kerbside.csv"))
    counted = [row for row in kerbside if "[N]" in row["source"]]
    genera = Counter(
        "UTD" if "UTD" in row["source"] else "GALK" if "GALK" in row["source"] else "mean of others"
        for row in _rows(PACKAGE / "scene" / "tree" / "genus.csv")
    )
    return _table(
        ("table", "rows", "basis"),
        [
            (
                "things at kerbs (`scene/clutter/kerbside.csv`)",
                len(kerbside),
                f"{len(counted)} counted by mappers around one street in Berlin-Neukölln, "
                f"{len(kerbside) - len(counted)} estimates",
            ),
            (
                "sizes of trees (`scene/tree/genus.csv`)",
                sum(genera.values()),
                ", ".join(f"{number} {name}" for name, number in genera.most_common()),
            ),
        ],
    )


TABLES: Mapping[str, Callable[[], str]] = {
    "materials": _materials,
    "sensors": _sensor_counts,
    "things": _things,
}


def with_tables(text: str) -> str:
    """Return a page with its tables made anew."""
    return MADE.sub(lambda found: f"{found[1]}{TABLES[found[2]]()}{found[3]}", text)


def long_pages() -> dict[str, str]:
    """Return the pages that only the site has, by name."""
    return {"sensor_numbers.md": _sensor_page(), "constants.md": _constant_page()}


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(with_tables(page.read_text()))
