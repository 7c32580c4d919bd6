"""Names shared by every stage: semantic classes, materials, classes of actors."""

from urbantwin.taxonomy.actor import (
    ACTOR_CLASSES,
    ACTOR_SEMANTICS,
    BOX_SEMANTICS,
    COMPANIONS,
    OBSTACLE,
    ROAD_USERS,
    BoxKind,
    road_user,
)
from urbantwin.taxonomy.format_class import Labelled, classes_in
from urbantwin.taxonomy.material import WAVELENGTHS_NM, Material, material_id, materials
from urbantwin.taxonomy.semantic import (
    GROUND_CLASSES,
    SemanticClass,
    semantic_classes,
    semantic_id,
)
from urbantwin.taxonomy.semantic_kitti import MOVING, KittiLabel, kitti_labels

__all__ = [
    "ACTOR_CLASSES",
    "ACTOR_SEMANTICS",
    "BOX_SEMANTICS",
    "COMPANIONS",
    "GROUND_CLASSES",
    "MOVING",
    "OBSTACLE",
    "ROAD_USERS",
    "WAVELENGTHS_NM",
    "BoxKind",
    "KittiLabel",
    "Labelled",
    "Material",
    "SemanticClass",
    "classes_in",
    "kitti_labels",
    "material_id",
    "materials",
    "road_user",
    "semantic_classes",
    "semantic_id",
]
