"""Our bodies in the boxes of labelled real frames: points, shape, codes and losses."""

from urbantwin.fidelity.objects.compare import ObjectsReport, compare_in_boxes, write_objects

__all__ = ["ObjectsReport", "compare_in_boxes", "write_objects"]
