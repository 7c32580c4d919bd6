"""A twin's static world as other programs' scenes."""

from urbantwin.exports.scene.write import SCENE_FORMATS, write_scene

__all__ = ["SCENE_FORMATS", "write_scene"]
