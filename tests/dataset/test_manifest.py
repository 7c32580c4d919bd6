from dataclasses import replace

from urbantwin.dataset.manifest import recipe_key, recipe_of
from urbantwin.geometry import LabelledMesh
from urbantwin.site.rig import Conditions


def test_a_resume_never_mixes_meshes_of_actors(twin, motion, rig):
    """Frames that were recorded with other meshes belong to another recipe."""

    def key(height):
        mesh = LabelledMesh.build([[0, 0, 0], [1, 0, 0], [0, 1, height]], [[0, 1, 2]], 10, 12)
        moving = replace(motion, meshes={("car-sedan", 0): mesh})
        return recipe_key(recipe_of(twin, moving, rig, 0, {0: 0.0}))

    assert key(1.0) == key(1.0)
    assert key(1.0) != key(1.001)


def test_a_resume_never_mixes_what_decides_the_frames(twin, motion, rig):
    """Paint on the road, where labels count, and how a sensor keeps time."""

    def key(rig=rig, **changed):
        other = replace(twin, manifest={**twin.manifest, **changed})
        return recipe_key(recipe_of(other, motion, rig, 0, {0: 0.0}))

    def with_sensor(**changed):
        return replace(rig, sensors=(replace(rig.sensors[0], **changed),))

    files = {**twin.manifest["files"], "surface_material.npz": "ab" * 32}
    keys = [
        key(),
        key(files=files),
        key(files={**files, "surface_material.npz": "cd" * 32}),
        key(region_m=[[0, 0], [9, 0], [9, 9]]),
        key(with_sensor(phase_deg=1.0)),
        key(with_sensor(returns="last")),
        key(replace(rig, conditions=Conditions(weather="fog", visibility_m=80.0))),
    ]
    assert key() == keys[0]
    assert len(set(keys)) == len(keys)
