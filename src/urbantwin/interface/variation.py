"""Counterfactuals: recordings that differ in one factor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge

from urbantwin.artefact import check_folder, replaced_folder, write_json
from urbantwin.artefact.tables import PARQUET
from urbantwin.errors import InputError, StageError
from urbantwin.experiments.journal import Journal
from urbantwin.interface.command import command
from urbantwin.interface.dataset import Dataset
from urbantwin.interface.motion import Motion
from urbantwin.interface.place import AnyPath
from urbantwin.interface.recording import recorders
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.interface.workbench import Workbench

if TYPE_CHECKING:
    import pyarrow as pa

    from urbantwin.experiments.variation.factor import Factor
    from urbantwin.experiments.variation.run_file import RunFile
    from urbantwin.interface.twin import Twin

__all__ = ["Variation", "vary"]


@dataclass(frozen=True, repr=False)
class Variation(Artefact):
    """Recordings that differ in one factor, in one folder.

    Attributes:
        folder: folder with one folder per recording, and ``comparison``.
        manifest: content of ``comparison/variation.json``.
    """

    folder: Path
    manifest: dict[str, Any]

    def __repr__(self) -> str:
        """Return the factor, the variants and the folder."""
        names = ", ".join(row["name"] for row in self.manifest["variants"])
        return f"Variation of {self.manifest['factor']}: {names} ({self.folder})"

    @property
    def base(self) -> Dataset:
        """The recording without the change."""
        return Dataset(self.folder / "base" / "dataset")

    def dataset(self, name: str) -> Dataset:
        """Return the recording of a variant, by its folder's name."""
        return Dataset(self.folder / name / "dataset")

    @property
    def fates(self) -> pa.Table:
        """State of every object in every frame, with a column ``variant``."""
        from urbantwin.artefact.tables import read_parquet

        return read_parquet(self.folder / "comparison" / "fates.parquet", "fates of objects")

    def summary(self) -> Summary:
        """Return the proof and the counts of object states, per variant."""
        rows = {
            row["name"]: {
                "only_this_differs": row["proof"]["one_factor"],
                "actors_changed": len(row["proof"]["actors"]["changed"]),
                "actors_added": len(row["proof"]["actors"]["added"]),
                "actors_removed": len(row["proof"]["actors"]["removed"]),
                "actors_differ_from_s": row["proof"]["actors"]["differ_from_s"],
                **row["fates"],
                "became": row["became"],
            }
            for row in self.manifest["variants"]
        }
        base = self.manifest["base"]["fates"]
        return Summary(path=str(self.folder), factor=self.manifest["factor"], base=base, **rows)


@command
def vary(
    run: AnyPath,
    out: AnyPath | None = None,
    *,
    changes: Annotated[str, "FACTOR=VALUES"],
    workers: Annotated[int | None, Ge(1)] = None,
    pictures: bool = True,
    progress: ShowProgress = True,
) -> Variation:
    """Record a run again with one factor changed.

    Checks that nothing else differs, and reports how the state of each object changed.

    Args:
        run: ``run.yaml``, or the folder that ``run`` or ``demo`` wrote.
        out: folder for the recordings; ``variation`` beside the run if not given.
        changes: factor and its values: ``sensor.height=4,5,6.5``, ``sensor.NAME.FIELD=VALUE``,
            ``signal.PROGRAM.offset=SECONDS``, ``scenario=FILE``, ``insert=bicycle`` or
            ``insert=CLASS@STREET``, ``weather=rain``, ``visibility=300``.
        workers: number of processes; every number gives the same bytes.
        pictures: draw the states of the objects.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the run or the factor cannot be used.
        StageError: a stage failed, or more than the factor differs.

    Example:
        >>> ut.experiment.vary("run.yaml", changes="sensor.height=4,6.5").fates
        $ urbantwin experiment vary urbantwin-demo/ --set sensor.height=4,6.5 -o sweep/
    """
    from urbantwin.experiments.variation.factor import read_factor
    from urbantwin.experiments.variation.run_file import RunFile
    from urbantwin.interface.twin import Twin

    described, factor = RunFile.read(Path(run)), read_factor(changes)
    place = described.file.parent / "variation" if out is None else Path(out)
    names = ["base", *(factor.name_of(value) for value in factor.values)]
    for name in names:
        for kind in ("dataset", "motion"):
            check_folder(place / name / kind, kind=kind, inputs=described.inputs)
    check_folder(place / "comparison", kind="variation", inputs=described.inputs)
    twin = Twin.open(described.twin)
    _check_values(described, factor, twin)  # check all values before anything is written
    with recorders(workers, pictures=False) as crew:
        bench = Workbench(Journal(place), twin, crew, progress=progress)
        motions = [_base_motion(described, bench)]
        made = [_recorded(described, None, "", bench, motions[0], "base/dataset")]
        for name, value in zip(names[1:], factor.values, strict=True):
            own = motions[0]
            if factor.changes_traffic:
                traffic = _traffic_of(described, factor, value, twin, own)
                own = _changed(described, bench, own, f"{name}/motion", traffic)
            motions.append(own)
            made.append(_recorded(described, factor, value, bench, own, f"{name}/dataset"))
    return _compared(bench, factor, names, made, motions, described.inputs, pictures)


def _check_values(described: RunFile, factor: Factor, twin: Twin) -> None:
    """Check the factor's values against the twin: sensors, signals and scenarios.

    Raises:
        InputError: see `Factor`.
    """
    from urbantwin.interface.rig import placed, rig_spec_on

    spec, file = rig_spec_on(twin, described.record.rig)
    for value in factor.values:
        if factor.kind == "sensor":
            placed(factor.rig_with(spec, value), twin, file)
        elif factor.kind == "scenario":
            factor.scenario_of(value, described.file)
        elif factor.kind == "insert":
            factor.one_more(value, twin, 0.0, 1.0)
    moving = described.motion if factor.changes_traffic else None
    if moving is not None and Motion.open(moving).manifest.get("asked") is None:
        raise InputError(
            "does not state its requested traffic",
            file=moving,
            expected="a motion of urbantwin drive, or traffic: in the run",
        )
    if factor.kind == "signal":
        known = sorted({one.program for one in twin.roads.signals})
        if factor.of not in known:
            raise InputError(
                f"there is no signal program {factor.of!r:.60}",
                place=f"--set {factor.text}",
                expected="one of " + ", ".join(known) if known else "a twin with signals",
            )


def _traffic_of(
    described: RunFile, factor: Factor, value: str, twin: Twin, motion: Motion
) -> dict[str, Any]:
    """Return the traffic settings of a variant that differ from the base's."""
    if factor.kind == "signal":
        return {"signal_offsets": {factor.of: factor.number_of(value)}}
    from urbantwin.traffic.events import load_scenario

    until_s = float(motion.manifest["duration_s"])
    if factor.kind == "insert":
        start_s, stop_s = described.record.start, described.record.stop
        last_s = until_s if stop_s is None else min(stop_s, until_s)
        one_more = factor.one_more(value, twin, start_s, last_s)
        return {"scenario": [*motion.manifest["asked"].get("scenario", ()), one_more]}
    file = factor.scenario_of(value, described.file)
    return {"scenario": load_scenario(file, twin, until_s)}


def _base_motion(described: RunFile, bench: Workbench) -> Motion:
    """Return the run's motion; simulate it if the run names none."""
    if described.motion is not None:
        return Motion.open(described.motion)
    return _driven(described, bench, "base/motion", {})


def _driven(described: RunFile, bench: Workbench, place: str, changes: Mapping[str, Any]) -> Motion:
    """Return the motion of the run's traffic with changes applied."""
    from urbantwin.site import load_traffic_changes
    from urbantwin.traffic.events import load_scenario

    traffic = described.traffic
    seconds, seed, asked = traffic.seconds, traffic.seed, {}
    if described.motion is not None:
        asked = dict(Motion.open(described.motion).manifest["asked"])
        seconds, seed = float(asked["duration_s"]), int(asked["seed"])
    elif traffic.demand is not None:
        asked = load_traffic_changes(traffic.demand)
    if traffic.scenario is not None:
        usual = asked.get("duration_s", bench.twin.site["traffic"]["duration_s"])
        until_s = float(usual) if seconds is None else seconds
        asked["scenario"] = load_scenario(traffic.scenario, bench.twin, until_s)
    return Motion.open(bench.motion(place, seconds, seed, {**asked, **changes}))


def _changed(
    described: RunFile, bench: Workbench, motion: Motion, place: str, traffic: Mapping[str, Any]
) -> Motion:
    """Return a variant's motion: the base's with inserted actors, or a new one."""
    from urbantwin.traffic.events import PUT_IN
    from urbantwin.traffic.run import with_more

    events = traffic.get("scenario", ())
    simulated = [one for one in events if one["event"] not in PUT_IN]
    if "scenario" not in traffic or simulated or "events" in motion.manifest:
        return _driven(described, bench, place, traffic)

    def put_in(folder: Path) -> None:
        with shown_stage("traffic", bench.progress) as tell:
            tell(0.0, "putting actors in")
            with_more(bench.twin, motion, events).save(folder)

    inputs = [bench.twin.folder, motion.folder]
    return Motion.open(bench.once(place, put_in, inputs, put_in=list(events)))


def _recorded(
    described: RunFile,
    factor: Factor | None,
    value: str,
    bench: Workbench,
    motion: Motion,
    place: str,
) -> Dataset:
    """Return a recording of a motion, with the factor's value applied if it is of recording."""
    from urbantwin.interface.rig import rig_spec_on
    from urbantwin.site.rig_changes import RigChanges

    record = described.record
    changes = RigChanges(
        effects=record.effects, weather=record.weather, visibility_m=record.visibility
    )
    if factor is not None and factor.kind == "weather":
        changes = replace(changes, weather=value)
    if factor is not None and factor.kind == "visibility":
        changes = replace(changes, visibility_m=factor.number_of(value))
    spec, file = rig_spec_on(bench.twin, record.rig, changes)
    if factor is not None and factor.kind == "sensor":
        spec = factor.rig_with(spec, value)
    span: dict[str, Any] = {"start_s": record.start, "stop_s": record.stop, "seed": record.seed}
    return Dataset(bench.dataset(place, motion, spec, file, split=None, **span))


def _compared(
    bench: Workbench,
    factor: Factor,
    names: list[str],
    made: list[Dataset],
    motions: list[Motion],
    inputs: list[Path | None],
    pictures: bool,
) -> Variation:
    """Check what differs, and compute the state of every object."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from urbantwin.experiments.variation.fates import FATES, fate_changes, fates_of
    from urbantwin.experiments.variation.proof import proof_of

    tables, rows = [], []
    with shown_stage("compare", bench.progress) as tell:
        for number, (name, dataset, motion) in enumerate(zip(names, made, motions, strict=True)):
            tell(number / len(names), f"what became of every object: {name}")
            table = fates_of(dataset.folder, motion, bench.twin)
            tables.append(table.add_column(0, "variant", pa.array([name] * table.num_rows)))
            counts = Counter(table["fate"].to_pylist())
            row: dict[str, Any] = {"name": name, "fates": {fate: counts[fate] for fate in FATES}}
            if number:
                proof = proof_of(made[0].manifest, dataset.manifest, motions[0], motion)
                if not proof["one_factor"]:
                    fields = [one["field"] for one in proof["changed"]] or ["nothing"]
                    raise StageError(
                        f"{name} does not differ from the base in one factor: "
                        f"{', '.join(fields[:6])} differ"
                    )
                row |= {"proof": proof, "became": fate_changes(tables[0], tables[-1])}
            rows.append(row)
        manifest = {
            "kind": "variation",
            "factor": factor.text,
            "twin_sha256": bench.twin.sha256,
            "base": rows[0],
            "variants": rows[1:],
            "warnings": [],
        }
        target, given = bench.folder / "comparison", [one for one in inputs if one]
        with replaced_folder(target, kind="variation", inputs=given) as folder:
            pq.write_table(pa.concat_tables(tables), folder / "fates.parquet", **PARQUET)
            write_json(folder / "variation.json", manifest)
            if pictures:
                from urbantwin.drawing.fates import fates_figure
                from urbantwin.drawing.style import save

                (folder / "pictures").mkdir()
                save(fates_figure(rows, factor.text), folder / "pictures" / "fates.png")
    return Variation(bench.folder, manifest)
