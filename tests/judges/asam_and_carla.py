"""Run by the judges' own Python: ASAM's checkers and CARLA's map, their answers as JSON.

The checkers need numpy 1, so all live in an environment of their own (`make judges`).
"""

import functools
import importlib
import json
import sys
from pathlib import Path

#: ASAM's bundle of checks for each kind of file.
BUNDLES = {".xodr": "qc_opendrive", ".xosc": "qc_openscenario"}


def check(path):
    """Every issue that ASAM's checker bundle reports, and how its checks ended."""
    import xmlschema
    from qc_baselib import Configuration, Result

    bundle = BUNDLES[path.suffix]
    constants = importlib.import_module(f"{bundle}.constants")
    # The schema of a version is compiled once for all files.
    if not hasattr(xmlschema.XMLSchema11, "cache_info"):
        xmlschema.XMLSchema11 = functools.cache(xmlschema.XMLSchema11)
    config = path.with_suffix(".config.xml")
    config.write_text(f'<Config><Param name="InputFile" value="{path}"/></Config>')
    configuration, result = Configuration(), Result()
    configuration.load_from_file(xml_file_path=str(config))
    result.register_checker_bundle(
        name=constants.BUNDLE_NAME, description="", version=constants.BUNDLE_VERSION, summary=""
    )
    result.set_result_version(version=constants.BUNDLE_VERSION)
    importlib.import_module(f"{bundle}.main").run_checks(configuration, result)
    found = result.get_checker_bundle_result(constants.BUNDLE_NAME)
    return {
        "issues": [f"{i.rule_uid}: {i.description}" for c in found.checkers for i in c.issues],
        "status": {c.checker_id: c.status.value for c in found.checkers},
    }


def load(path):
    """What CARLA makes of a map, in its own frame with y turned back."""
    import carla

    chart = carla.Map(path.stem, path.read_text())

    def point(location):
        return [location.x, -location.y, location.z]

    def row(w):
        return [w.road_id, w.lane_id, w.s, *point(w.transform.location), w.transform.rotation.yaw]

    waypoints = chart.generate_waypoints(2.0)
    origin = chart.transform_to_geolocation(carla.Location(0, 0, 0))
    return {
        "waypoints": [row(w) for w in waypoints],
        "dead_ends": [row(w) for w in waypoints if not w.next(2.0)],
        "topology": [[row(a), row(b)] for a, b in chart.get_topology()],
        "crosswalks": [point(corner) for corner in chart.get_crosswalks()],
        "landmarks": [
            [mark.id, mark.type, mark.road_id, mark.s, *point(mark.transform.location)]
            for mark in chart.get_all_landmarks()
        ],
        "origin": [origin.latitude, origin.longitude],
    }


if __name__ == "__main__":
    answers = {}
    for task in sys.argv[1:]:
        judge, name = task.split("=", 1)
        answers[task] = {"check": check, "carla": load}[judge](Path(name))
    print(json.dumps(answers))
