"""A twin in other programs' formats."""

from urbantwin.export.formats import FORMATS, Format, export_twin, format_named

__all__ = ["FORMATS", "Format", "export_twin", "format_named"]
