from dataclasses import replace

from urbantwin.dataset.manifest import recipe_key, recipe_of
from urbantwin.geometry import LabelledMesh


def test_a_resume_never_mixes_meshes_of_actors(twin, motion, rig):
    """Frames that were recorded with other meshes belong to another recipe."""

    def key(height):
        mesh = LabelledMesh.build([[0, 0, 0], [1, 0, 0], [0, 1, height]], [[0, 1, 2]], 10, 12)
        moving = replace(motion, meshes={("car-sedan", 0): mesh})
        return recipe_key(recipe_of(twin, moving, rig, 0, {0: 0.0}))

    assert key(1.0) == key(1.0)
    assert key(1.0) != key(1.001)
