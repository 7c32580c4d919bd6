"""A twin in other programs' formats."""

from urbantwin.exports.formats import FORMATS, Exported, Format, export_twin, format_named

__all__ = ["FORMATS", "Exported", "Format", "export_twin", "format_named"]
