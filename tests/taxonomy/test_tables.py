from urbantwin.taxonomy import (
    ACTOR_CLASSES,
    ACTOR_SEMANTICS,
    materials,
    semantic_classes,
    semantic_id,
)

#: Learning map of SemanticKITTI, config/semantic-kitti.yaml: label -> name (the classes we use).
SEMANTIC_KITTI = {
    10: "car", 13: "bus", 15: "motorcycle", 18: "truck", 30: "person", 31: "bicyclist",
    32: "motorcyclist", 40: "road", 44: "parking", 48: "sidewalk", 49: "other-ground",
    50: "building", 51: "fence", 52: "other-structure", 70: "vegetation", 71: "trunk",
    72: "terrain", 80: "pole", 81: "traffic-sign", 99: "other-object",
}  # fmt: skip


def test_numbers_are_semantic_kittis():
    ours = {c.id: c.name for c in semantic_classes().values() if c.id}
    assert {**ours, 30: "person"} == SEMANTIC_KITTI


def test_every_actor_class_has_a_countable_semantic_class():
    for name in ACTOR_CLASSES:
        assert semantic_classes()[ACTOR_SEMANTICS[name]].thing
    assert semantic_id("unlabelled") == 0


def test_materials_are_numbered_in_order_and_physical():
    table = list(materials().values())
    assert [m.id for m in table] == list(range(len(table)))
    for material in table:
        assert 0 < material.reflectivity <= 1
        assert 0 <= material.transmission < 1
        assert material.source
