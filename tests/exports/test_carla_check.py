"""Packages for CARLA before its rules: sound ones, and ones with one thing wrong each."""

import copy
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from lxml import etree

import urbantwin as ut
from urbantwin.errors import InputError
from urbantwin.exports.carla.check import check_package, import_rules, road_rules, walking_rules
from urbantwin.exports.carla.check.read import _asked, read_package
from urbantwin.exports.carla.check.rules import findings


@pytest.fixture(scope="module")
def folder(small_package):
    return small_package


@pytest.fixture(scope="module")
def package(folder, carla_python):
    return read_package(folder, carla_python)


def by_rule(found):
    return {one.rule: one.problems for one in found}


def test_a_package_as_it_was_written_breaks_no_rule(folder, carla_python):
    found = check_package(folder, python=carla_python)
    assert len(found) == 13
    assert by_rule(found) == {one.rule: () for one in found}
    assert not any(one.missing for one in found)
    (heights,) = next(one.notes for one in found if one.rule == "waypoints over the mesh")
    assert heights.endswith("m")


@pytest.mark.thorough
def test_a_real_place_of_left_hand_traffic_breaks_no_rule(perth_package, carla_python):
    found = check_package(perth_package, python=carla_python)
    assert by_rule(found) == {one.rule: () for one in found}


def test_without_carla_its_rules_are_told_as_not_applied(folder, tmp_path):
    (tmp_path / "python").write_text("#!/bin/sh\necho \"No module named 'carla'\" >&2; exit 1\n")
    (tmp_path / "python").chmod(0o755)
    found = {one.rule: one.missing for one in check_package(folder, python=tmp_path / "python")}
    assert found["names of meshes"] == ""
    assert "urbantwin[carla]" in found["lanes without dead ends"]


def changed(package, change, **more):
    """The package with another OpenDRIVE."""
    roads = copy.deepcopy(package.roads)
    change(roads)
    return replace(package, roads=roads, **more)


def asked(package, change, python, tmp_path):
    """The package with another OpenDRIVE, which CARLA has read."""
    other = changed(package, change)
    path = tmp_path / "other.xodr"
    path.write_bytes(etree.tostring(other.roads))
    spawns = package.plan["spawn_points"]["spawn_points"]
    return replace(other, carla=_asked(path, "other", spawns, python))


def only(problems):
    (found,) = problems
    return found


def test_make_import_would_take_another_json_for_a_package(package, tmp_path):
    other = tmp_path / package.import_folder.name
    shutil.copytree(package.import_folder, other)
    (other / "notes.json").write_text("{}")
    assert "notes.json" in only(import_rules.document(replace(package, import_folder=other)))
    (other / "notes.json").unlink()
    document = other / f"{other.name}.json"
    content = json.loads(document.read_text())
    for change, said in (
        ({"name": "My Map"}, "My Map"),
        ({"source": "./x.fbx"}, "source names no file"),
        ({"tiles": []}, "no navigation"),
        ({"use_carla_materials": "yes"}, "neither true nor false"),
    ):
        entry = content["maps"][0] | change
        document.write_text(json.dumps({"maps": [entry], "props": []}))
        assert said in " ".join(import_rules.document(replace(package, import_folder=other)))
    for text in ("[]", "{", '{"maps": []}', '{"maps": [1], "props": []}'):
        document.write_text(text)
        assert list(import_rules.document(replace(package, import_folder=other)))


def test_meshes_that_carla_would_lose_or_misplace_are_named(package):
    mesh = package.mesh

    def renamed(name):
        return replace(package, mesh=replace(mesh, nodes=(name, *mesh.nodes[1:])))

    twice = " ".join(import_rules.meshes(renamed(mesh.nodes[1].upper())))
    assert "Unreal keeps one" in twice
    assert "more than letters" in only(import_rules.meshes(renamed("Road Road 0")))
    assert "is none of" in only(import_rules.meshes(renamed("House_0")))
    lit = replace(package, name="Lightfoot_Road")
    assert len(list(import_rules.meshes(lit))) > 20  # not one would be placed
    bright = (("M_light_grey",), *mesh.materials[1:])
    found = only(import_rules.materials(replace(package, mesh=replace(mesh, materials=bright))))
    assert "would not be placed" in found


def test_another_unit_version_or_size_is_told(package):
    mesh = package.mesh
    for change, said in (
        ({"unit_m": 1.0}, "its unit is 1.0 m"),
        ({"version": 0}, "not binary"),
        ({"corners": mesh.corners * 100}, "m wide"),
        ({"corners": mesh.corners[:0], "node": mesh.node[:0]}, "no triangle"),
    ):
        found = list(import_rules.settings(replace(package, mesh=replace(mesh, **change))))
        assert said in found[0]


@pytest.mark.parametrize("change", [[1, -1, 1], [100, 100, 100]])
def test_a_mesh_in_another_frame_than_the_roads_is_told(package, change):
    mesh = replace(package.mesh, corners=(package.mesh.corners * change)[:, ::-1])
    found = " ".join(road_rules.on_mesh(replace(package, mesh=mesh)))
    assert "m beside the carriageway" in found or "above or below" in found
    lifted = replace(package.mesh, corners=package.mesh.corners + [0, 0, 2.0])
    assert "above or below" in only(road_rules.on_mesh(replace(package, mesh=lifted)))


def test_a_dead_end_inside_the_map_is_told(package, carla_python, tmp_path):
    def cut(roads):
        junction = max(roads.iter("junction"), key=len)
        incoming = junction.find("connection").get("incomingRoad")
        for one in junction.findall(f"connection[@incomingRoad='{incoming}']"):
            junction.remove(one)

    found = list(road_rules.lanes(asked(package, cut, carla_python, tmp_path)))
    assert any("ends at" in one and "inside the map" in one for one in found)
    assert any("no way leads to" in one for one in found)


def test_signals_for_nobody_or_for_the_other_direction_are_told(package, carla_python, tmp_path):
    def opened(roads):
        for item in roads.iter("signal"):
            if item.get("type") == "1000002":
                for one in item.findall("validity"):
                    item.remove(one)

    other = asked(package, opened, carla_python, tmp_path)
    found = list(road_rules.signal_lanes(other))
    assert any("for people on foot, stops vehicles" in one for one in found)
    assert all("names no lanes" in one for one in road_rules.signals(other))
    assert list(road_rules.signals(other))

    def turned(roads):
        item = next(e for e in roads.iter("signal") if e.get("type") == "274")
        item.set("orientation", "-" if item.get("orientation") == "+" else "+")

    assert "of the other direction" in only(road_rules.signals(changed(package, turned)))

    def unknown(roads):
        next(e for e in roads.iter("signal") if e.get("type") == "274").set("type", "99")

    assert "CARLA does not know" in only(road_rules.signals(changed(package, unknown)))

    def slow(roads):
        next(e for e in roads.iter("signal") if e.get("type") == "274").set("subtype", "-1")

    assert "no plate" in only(road_rules.signals(changed(package, slow)))


def test_one_controller_for_a_whole_junction_is_told(package):
    def merged(roads):
        first, *rest = roads.findall("controller")
        for one in rest:
            first.extend(one.findall("control"))
            roads.remove(one)
            for named in roads.findall(f"junction/controller[@id='{one.get('id')}']"):
                named.getparent().remove(named)

    assert "green at once" in only(road_rules.stages(changed(package, merged)))

    def lost(roads):
        roads.find("controller/control").set("signalId", "999999")

    found = list(road_rules.stages(changed(package, lost)))
    assert any("999999, which does not exist" in one for one in found)

    def nowhere(roads):
        for named in roads.findall("junction/controller"):
            named.set("id", "888888")

    found = " ".join(road_rules.stages(changed(package, nowhere)))
    assert "888888, which does not exist" in found
    assert "of no junction" in found


def test_a_light_far_from_its_stop_line_is_told(package):
    moved = copy.deepcopy(package.carla)
    one = next(s for s in moved["signals"] if s["type"] == "1000001" and s["driven"])
    one["s"] -= 12.0
    found = only(road_rules.stop_places(replace(package, carla=moved)))
    assert found.startswith(f"signal {one['id']} stops vehicles 12.0 m from the stop line")


def test_spawn_points_beside_lanes_or_against_traffic_are_told(package, folder, carla_python):
    points = copy.deepcopy(package.plan["spawn_points"]["spawn_points"])[:3]
    points[0]["location"]["x"] += 60.0
    points[1]["rotation"]["yaw"] += 180.0
    path = package.import_folder / package.name / f"{package.name}.xodr"
    answer = _asked(path, "m", points, carla_python)
    found = list(road_rules.spawn_points(replace(package, carla=answer)))
    assert [one.split(" is ")[0] for one in found] == ["spawn point 0", "spawn point 1"]


def test_navigation_in_another_unit_or_with_other_names_is_told(package, tmp_path):
    text = (package.folder / "navigation" / f"{package.name}.obj").read_text()
    (tmp_path / "navigation").mkdir()
    path = tmp_path / "navigation" / f"{package.name}.obj"
    other = replace(package, folder=tmp_path)
    path.write_text(text)
    assert list(walking_rules.navigation(other)) == []
    path.write_text(text.replace("usemtl sidewalk", "usemtl pavement"))
    found = " ".join(walking_rules.navigation(other))
    assert "'pavement' is none of" in found
    assert "sidewalk: 0 triangles" in found
    lines = [
        "v " + " ".join(str(100 * float(v)) for v in line.split()[1:])
        if line.startswith("v ") else line
        for line in text.splitlines()
    ]  # fmt: skip
    path.write_text("\n".join(lines))
    assert "bounds are not those of the FBX" in " ".join(walking_rules.navigation(other))
    path.write_text("f 1 2 3\n")
    with pytest.raises(InputError, match="not an OBJ"):
        list(walking_rules.navigation(other))


def test_crosswalks_that_face_down_or_are_bent_are_told(package):
    corners = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0], [0, 0, 0]], float)
    bent = np.array([[0, 0, 0], [9, 0, 0], [9, 9, 0], [4, 1, 0], [0, 9, 0], [0, 0, 0]], float)

    def drawn(rings):
        return replace(package, carla={"crosswalks": (np.concatenate(rings) * [1, -1, 1]).tolist()})

    assert list(walking_rules.crosswalks(drawn([corners]))) == []
    found = list(walking_rules.crosswalks(drawn([corners, corners[::-1] + [20, 0, 0], bent])))
    assert [one.split(":")[0] for one in found] == [
        "crosswalk 1 faces down",
        "crosswalk 2 is not convex",
    ]
    assert "2 of 2 crosswalks" in only(walking_rules.without_sidewalk(drawn([corners + 900] * 2)))


def test_verify_puts_a_package_before_the_rules(folder, tmp_path):
    found = ut.dataset.verify(folder, progress=False)
    assert found
    said = found.summary()
    rules = {row["rule"] for row in said["carla"]}
    assert {"names of meshes", "controllers are stages", "where people walk"} <= rules
    assert "live server" in said["not_proven"]
    found.check()
    broken = tmp_path / "carla"
    shutil.copytree(folder, broken)
    (broken / "spawn_points.json").unlink()
    with pytest.raises(InputError, match="missing"):
        ut.dataset.verify(broken, progress=False).check()


def test_a_rule_that_cannot_be_applied_says_so(package):
    def spoiled(roads):
        roads.find(".//validity").set("toLane", "x")

    found = by_rule(findings(changed(package, spoiled)))
    assert "cannot be read (ValueError" in found["signals and signs"][0]
    assert found["names of meshes"] == ()


def test_what_carla_cannot_read_is_told_in_one_line(package, carla_python, tmp_path):
    (tmp_path / "m.xodr").write_text("<OpenDRIVE>")
    with pytest.raises(InputError, match="CARLA cannot read it") as caught:
        _asked(tmp_path / "m.xodr", "m", [], carla_python)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("face", ["1 2 9", "1 2", f"1 2 {2**64}", f"1 2 -{2**63 + 1}", "1 2 x"])
def test_an_obj_of_no_triangles_is_one_line(tmp_path, face):
    file = tmp_path / "a.obj"
    file.write_text(f"v 0 0 0\nv 1 0 0\nv 1 0 1\nusemtl sidewalk\nf {face}\n")
    with pytest.raises(InputError, match="is not an OBJ of triangles"):
        walking_rules.triangles_of_obj(file)
