"""UrbanTwin: a real street intersection as a LiDAR digital twin and as labelled training data.

Every command is a function here, with the command's options and its defaults:

    import urbantwin as ut

    twin = ut.build("examples/two-avenues/site.yaml")
    motion = ut.drive(twin, seconds=60)
    dataset = ut.record(twin, motion, rig="rig.yaml")
    report = ut.compare("real/", dataset)
    dataset[3].points, ut.open("out/dataset").boxes, twin.plot()

What they need is imported when they are first used. docs/python.md tells more.
"""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.dataset.reading.fleet import FleetFrame, NodeFrame
    from urbantwin.dataset.reading.frame import Frame
    from urbantwin.dataset.reading.selection import Frames, Selection
    from urbantwin.errors import InputError, StageError, UrbanTwinError
    from urbantwin.fidelity.clouds import Cloud
    from urbantwin.fidelity.readers.recording import Recording
    from urbantwin.interface.actor_catalogue import ActorCatalogue, actors
    from urbantwin.interface.aligned_rig import AlignedRig, align
    from urbantwin.interface.campaign import campaign
    from urbantwin.interface.campaign_folder import Campaign
    from urbantwin.interface.carla_frames import CarlaFrames, carla
    from urbantwin.interface.coverage_map import Coverage, coverage
    from urbantwin.interface.curriculum import Curriculum, curriculum
    from urbantwin.interface.dataset import Dataset, Datasets, Fleet
    from urbantwin.interface.dataset_card import Card, card
    from urbantwin.interface.dataset_split import DatasetSplit, split
    from urbantwin.interface.detected_objects import DetectedObjects, detect
    from urbantwin.interface.discovered_rig import DiscoveredRig, discover
    from urbantwin.interface.evaluation_report import Evaluation, evaluate
    from urbantwin.interface.explanation import Explanation, explain
    from urbantwin.interface.exported import Exported, export
    from urbantwin.interface.film import Film, film
    from urbantwin.interface.fusion_study import FusionStudy, fuse
    from urbantwin.interface.improvement import Improved, improve
    from urbantwin.interface.input_check import Findings, check
    from urbantwin.interface.inspection import inspect
    from urbantwin.interface.labelled_recording import LabelledRecording, label
    from urbantwin.interface.measured_background import Background, background
    from urbantwin.interface.motion import Motion, drive
    from urbantwin.interface.objects_report import ObjectsReport
    from urbantwin.interface.observed_traffic import ObservedTraffic, observe
    from urbantwin.interface.opening import Package, open
    from urbantwin.interface.placement import Placement, place
    from urbantwin.interface.preset_catalogue import PresetCatalogue, presets
    from urbantwin.interface.recorded_traffic import Calibration, calibrate, replay
    from urbantwin.interface.recording import record
    from urbantwin.interface.regression import Suite, suite
    from urbantwin.interface.report import Report, compare
    from urbantwin.interface.reproduction import Reproduction, reproduce
    from urbantwin.interface.sensor_catalogue import Datasheet, SensorCatalogue, sensors
    from urbantwin.interface.sequence import SequenceFiles, sequence
    from urbantwin.interface.site_file import Site, init
    from urbantwin.interface.stored_dataset import StoredDataset
    from urbantwin.interface.study import Study, study
    from urbantwin.interface.summary import Summary
    from urbantwin.interface.teaching import Taught, teach
    from urbantwin.interface.tracked_objects import TrackedObjects, track
    from urbantwin.interface.trained_model import TrainedModel, pretrain, train
    from urbantwin.interface.tuning import Tuning, tune
    from urbantwin.interface.twin import Twin, build
    from urbantwin.interface.variation import Variation, vary
    from urbantwin.interface.verification import Verification, verify
    from urbantwin.interface.viewing import View, look
    from urbantwin.interface.whole_line import Run, demo, run
    from urbantwin.result_warning import ResultWarning
    from urbantwin.site.rig import RigSpec

__version__ = "0.9.0"

__all__ = [
    "ActorCatalogue",
    "AlignedRig",
    "Background",
    "Calibration",
    "Campaign",
    "Card",
    "CarlaFrames",
    "Cloud",
    "Coverage",
    "Curriculum",
    "Dataset",
    "DatasetSplit",
    "Datasets",
    "Datasheet",
    "DetectedObjects",
    "DiscoveredRig",
    "Evaluation",
    "Explanation",
    "Exported",
    "Film",
    "Findings",
    "Fleet",
    "FleetFrame",
    "Frame",
    "Frames",
    "FusionStudy",
    "Improved",
    "InputError",
    "LabelledRecording",
    "Motion",
    "NodeFrame",
    "ObjectsReport",
    "ObservedTraffic",
    "Package",
    "Placement",
    "PresetCatalogue",
    "Recording",
    "Report",
    "Reproduction",
    "ResultWarning",
    "RigSpec",
    "Run",
    "Selection",
    "SensorCatalogue",
    "SequenceFiles",
    "Site",
    "StageError",
    "StoredDataset",
    "Study",
    "Suite",
    "Summary",
    "Taught",
    "TrackedObjects",
    "TrainedModel",
    "Tuning",
    "Twin",
    "UrbanTwinError",
    "Variation",
    "Verification",
    "View",
    "__version__",
    "actors",
    "align",
    "background",
    "build",
    "calibrate",
    "campaign",
    "card",
    "carla",
    "check",
    "compare",
    "coverage",
    "curriculum",
    "demo",
    "detect",
    "discover",
    "drive",
    "evaluate",
    "explain",
    "export",
    "film",
    "fuse",
    "improve",
    "init",
    "inspect",
    "label",
    "look",
    "observe",
    "open",
    "place",
    "presets",
    "pretrain",
    "record",
    "replay",
    "reproduce",
    "run",
    "sensors",
    "sequence",
    "split",
    "study",
    "suite",
    "teach",
    "track",
    "train",
    "tune",
    "vary",
    "verify",
]

names_on_demand(__name__)
