"""Run by the judges' own Python: what ASAM's checker finds in an OpenSCENARIO file, as JSON."""

import json
import sys
from pathlib import Path


def check(path):
    """Every issue that ASAM's checker bundle reports, and how its checks ended."""
    from qc_baselib import Configuration, Result
    from qc_openscenario import constants
    from qc_openscenario.main import run_checks

    config = path.with_suffix(".config.xml")
    config.write_text(f'<Config><Param name="InputFile" value="{path}"/></Config>')
    configuration, result = Configuration(), Result()
    configuration.load_from_file(xml_file_path=str(config))
    result.register_checker_bundle(
        name=constants.BUNDLE_NAME, description="", version=constants.BUNDLE_VERSION, summary=""
    )
    result.set_result_version(version=constants.BUNDLE_VERSION)
    run_checks(configuration, result)
    bundle = result.get_checker_bundle_result(constants.BUNDLE_NAME)
    return {
        "issues": [f"{i.rule_uid}: {i.description}" for c in bundle.checkers for i in c.issues],
        "status": {c.checker_id: c.status.value for c in bundle.checkers},
    }


if __name__ == "__main__":
    print(json.dumps(check(Path(sys.argv[1]))))
