"""Generated reference: public names (mkdocstrings), help of the commands, fields of the files."""

import re
from importlib import import_module
from typing import Any

import click

from urbantwin.cli.commands import GROUPS, every_command
from urbantwin.cli.program import program
from urbantwin.site.rig import RigSpec
from urbantwin.site.site import _SiteFile

__all__ = ["command_page", "field_page", "python_pages"]


def python_pages() -> dict[str, str]:
    """Return the pages of the public names: of the main road, and of each group.

    What a group's package names besides its commands and their results is not public.
    """
    pages = {"main_road.md": _page("urbantwin", "The main road", "What `ut` itself has.")}
    for group, (title, _) in GROUPS.items():
        pages[f"{group}.md"] = _page(f"urbantwin.{group}", f"ut.{group}", f"{title}.")
    return pages


def _page(package: str, title: str, told: str) -> str:
    module = import_module(package)
    names = [
        name
        for name in module.__all__
        if name not in GROUPS and not name.startswith("__")
        if package == "urbantwin" or _of_interface(vars(module)["_modules"].get(name, ""))
    ]
    names.sort(key=lambda name: (name[0].isupper(), name))
    return "\n".join((f"# {title}\n\n{told}\n", *(f"::: {package}.{name}" for name in names)))


def _of_interface(module: str) -> bool:
    return module.startswith("urbantwin.interface.")


def command_page() -> str:
    """Return the help of every command."""
    parts = [
        "# Help of each command\n\nWhat `urbantwin COMMAND --help` prints; "
        "[a table](commands.md) says what each is for."
    ]
    whole = program()
    with click.Context(whole, info_name="urbantwin") as context:
        for group, name in every_command():
            above = whole.get_command(context, group) if group else whole
            assert isinstance(above, click.Group)
            command = above.get_command(context, name)
            assert command is not None
            words = f"{group} {name}".strip()
            with click.Context(command, info_name=f"urbantwin {words}", terminal_width=100) as own:
                parts.append(f"## {words}\n\n```text\n{command.get_help(own).rstrip()}\n```")
    return "\n\n".join(parts) + "\n"


# ---- fields of the files that people write ---------------------------------------------------

#: A line of the section "Attributes:" of a docstring, with its continuation lines.
_ATTRIBUTE = re.compile(r"^ {4}([\w, ]+): (.*(?:\n {8,}.*)*)", re.MULTILINE)


def field_page() -> str:
    """Return all fields of `site.yaml` and of a rig, from the models that check them."""
    parts = [
        "# All fields of the files\n\nWhat `site.yaml` and a rig file may contain, generated from "
        "the code that checks them. [site.yaml](site_file.md) and [the rig file](rig_file.md) "
        "explain the main ones."
    ]
    schemas: dict[str, dict[str, Any]] = {}
    for title, model in (("site.yaml", _SiteFile), ("rig.yaml", RigSpec)):
        schema = model.model_json_schema()
        schemas |= schema.pop("$defs", {})
        parts.append(_fields(title, schema))
    tables = sorted((_title(name), schema) for name, schema in schemas.items())
    parts += [_fields(name, schema) for name, schema in tables if schema.get("properties")]
    return "\n\n".join(parts) + "\n"


def _title(model: str) -> str:
    return model.strip("_").removesuffix("Spec")


def _fields(title: str, schema: dict[str, Any]) -> str:
    doc = schema.get("description", "")
    said = {
        name.strip(): re.sub(r"\s+", " ", text)
        for names, text in _ATTRIBUTE.findall(doc.partition("Attributes:")[2])
        for name in names.split(",")
    }
    rows = []
    for name, field in schema["properties"].items():
        text = field.get("description") or said.get(name) or said.get(field.get("title", ""), "")
        default = "required" if name in schema.get("required", ()) else _default(field)
        rows.append(f"| `{name}` | {_kind(field)} | {default} | {_cell(text)} |")
    lead = doc.partition("\n\n")[0].replace("\n", " ")
    head = f"## {title}\n\n{lead}\n\n" if lead else f"## {title}\n\n"
    return head + "| field | values | default | meaning |\n|---|---|---|---|\n" + "\n".join(rows)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("``", "`").replace("<", "&lt;")


def _default(field: dict[str, Any]) -> str:
    value = field.get("default")
    if value is None or isinstance(value, dict | list):
        return ""
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _kind(field: dict[str, Any]) -> str:
    """Return the values of a field in words: a type with its limits, names, a model."""
    if "$ref" in field:
        name = _title(field["$ref"].rpartition("/")[2])
        kind = f"[{name}](#{name.lower()})"
    elif "enum" in field or "const" in field:
        kind = ", ".join(f"`{value}`" for value in field.get("enum", [field.get("const")]))
    elif several := field.get("anyOf") or field.get("oneOf"):
        kind = " or ".join(_kind(one) for one in several if one.get("type") != "null")
    elif field.get("type") == "array":
        kind = f"list of {_kind(field['items'])}" if field.get("items") else "list"
    elif field.get("type") == "object" and isinstance(field.get("additionalProperties"), dict):
        kind = f"mapping of names to {_kind(field['additionalProperties'])}"
    else:
        words = {"boolean": "true or false", "object": "mapping", "string": "text", "": "any"}
        kind = words.get(field.get("type", ""), field.get("type", "")) + _limits(field)
    return kind


def _limits(field: dict[str, Any]) -> str:
    low = field.get("minimum", field.get("exclusiveMinimum"))
    high = field.get("maximum", field.get("exclusiveMaximum"))
    lower = "" if low is None else f" from {low:g}"
    return lower if high is None else f"{lower} to {high:g}"
