"""Export of a twin's static scene to scene formats."""

from urbantwin.exports.scene.write import SCENE_FORMATS, write_scene

__all__ = ["SCENE_FORMATS", "write_scene"]
