"""UrbanTwin: a real street intersection as a LiDAR digital twin and as labelled training data.

The main commands are here; each group of commands is a module: ``site``, ``traffic``, ``rig``,
``dataset``, ``model``, ``experiment`` and ``catalogue``. Every command is a function of the same
name, with the command's options and defaults:

    import urbantwin as ut

    twin = ut.build("examples/two-avenues/site.yaml")
    motion = ut.drive(twin, seconds=60)
    dataset = ut.record(twin, motion, rig="rig.yaml")
    report = ut.compare("real/", dataset)
    model = ut.model.train(dataset)
    dataset[3].points, ut.open("out/dataset").boxes, twin.plot()

Submodules are imported on first use. See docs/guide/dataset.md.
"""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin import catalogue, dataset, experiment, model, rig, site, traffic
    from urbantwin.dataset.reading.frame import Frame
    from urbantwin.errors import InputError, StageError, UrbanTwinError
    from urbantwin.interface.dataset import Dataset, Datasets, Fleet
    from urbantwin.interface.exported import export
    from urbantwin.interface.inspection import info
    from urbantwin.interface.motion import Motion, drive
    from urbantwin.interface.opening import open
    from urbantwin.interface.recording import record
    from urbantwin.interface.report import Report, compare
    from urbantwin.interface.site_file import init
    from urbantwin.interface.twin import Twin, build
    from urbantwin.interface.viewing import view
    from urbantwin.interface.whole_line import demo, run
    from urbantwin.result_warning import ResultWarning

__version__ = "0.9.0"

__all__ = [
    "Dataset",
    "Datasets",
    "Fleet",
    "Frame",
    "InputError",
    "Motion",
    "Report",
    "ResultWarning",
    "StageError",
    "Twin",
    "UrbanTwinError",
    "__version__",
    "build",
    "catalogue",
    "compare",
    "dataset",
    "demo",
    "drive",
    "experiment",
    "export",
    "info",
    "init",
    "model",
    "open",
    "record",
    "rig",
    "run",
    "site",
    "traffic",
    "view",
]

names_on_demand(__name__)
