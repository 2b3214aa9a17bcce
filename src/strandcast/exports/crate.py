"""`export crate`: an experiment as an RO-Crate 1.1 (Process Run Crate), to deposit in an archive.

The files lie in the crate as in the project, so that an unpacked crate is read as a project. Every stage is a
`CreateAction`, with inputs and outputs from the lineage in the records.

Sources: https://w3id.org/ro/crate/1.1 and https://w3id.org/ro/wfrun/process/0.5.
"""

import json
import os
import shutil
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

from strandcast.api import ExperimentView
from strandcast.core.trial_names import in_trial_order
from strandcast.errors import StrandcastError
from strandcast.exports.throw import refuse_filled
from strandcast.packages import optional_package
from strandcast.records.files import atomic_write, check_room, sha256_file, write_bytes
from strandcast.records.folders import files_of_video, parted
from strandcast.records.lineage import relative_to
from strandcast.records.summary import VersionGroup, group_by_versions
from strandcast.records.verdict import Verdict
from strandcast.records.verified import READERS
from strandcast.stages.context import Context
from strandcast.stages.declarations import STAGES
from strandcast.stages.job import Files, Job

METADATA = "ro-crate-metadata.json"
PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
# Gives `sha256` a meaning, which the context of RO-Crate 1.1 does not.
TERMS = "https://w3id.org/ro/terms/workflow-run/context"
ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip can hold: equal files, equal bytes
MEDIA_TYPES = {
    ".avi": "video/x-msvideo",
    ".csv": "text/csv",
    ".html": "text/html",
    ".json": "application/json",
    ".mkv": "video/x-matroska",
    ".mov": "video/quicktime",
    ".mp4": "video/mp4",
    ".parquet": "application/vnd.apache.parquet",
    ".png": "image/png",
    ".tif": "image/tiff",
    ".tiff": "image/tiff",
    ".toml": "application/toml",
    ".urdf": "application/xml",
    ".webp": "image/webp",
    ".yaml": "application/yaml",
}
NO_LICENCE = "No licence was stated when this crate was made: ask its authors before you use it."


@dataclass(frozen=True)
class _StageRun:
    """A stage that ran: the names of the files that it read and wrote, and the versions that it ran with."""

    stage: str
    job: Job
    made_by: dict[str, str]
    inputs: set[str] = field(default_factory=set)
    outputs: set[str] = field(default_factory=set)

    def named(self, between: str, trial: str) -> str:
        """Return its name: the stage, the camera if there are several, the trial if it is of one."""
        _, camera = parted(self.job.context.name)
        trial = trial.format(self.job.trial) if self.job.trial else ""
        return between.join(part for part in (self.stage, camera, trial) if part)

    @property
    def name(self) -> str:
        return self.named(", ", "trial {}")


def export_crate(
    experiment: ExperimentView,
    out: Path,
    *,
    without_video: bool = False,
    published: date | None = None,
    licence: str | None = None,
) -> int:
    """Write an experiment as a crate, a folder or a .zip; return the number of files in it.

    Parameters
    ----------
    without_video
        Leave the raw videos out; the crate names them with their hashes.
    published
        Date of publication; without it the day [UTC] of the newest raw file, as results hold no dates.
    licence
        SPDX identifier of the data's licence, e.g. ``CC-BY-4.0``.

    Raises
    ------
    StrandcastError
        SC-W012 the package rocrate is missing; SC-E005 the folder is not empty; SC-W030 no result is there;
        otherwise as the readers of results.
    """
    library = optional_package("rocrate.rocrate", "rocrate", "crate")
    zipped = out.suffix.lower() == ".zip"
    if not zipped:
        refuse_filled(out, "a crate")
    runs = _stage_runs(experiment)
    if not runs:
        what, fix = "has no results to export", f"strandcast run {experiment.name}"
        raise StrandcastError("SC-W030", what, file=experiment.context.folder.results, fix=fix)
    files = _files(experiment, {name for run in runs for name in run.inputs})
    left_out = (
        {name: files.pop(name) for name in sorted(_videos(experiment) & set(files))} if without_video else {}
    )
    check_room(out.parent, sum(path.stat().st_size for path in files.values()))

    crate = library.ROCrate(version="1.1")
    crate.metadata.extra_contexts.append(TERMS)
    entities = {
        name: crate.add_file(path, name, properties=_content(name, path)) for name, path in files.items()
    }
    entities |= {name: _add_left_out(crate, name, path) for name, path in left_out.items()}
    actions = _add_actions(crate, runs, entities)
    root = crate.root_dataset
    root["name"] = experiment.settings.title or experiment.name
    root["description"] = _description(experiment, left_out)
    root["datePublished"] = (published or _newest_day(experiment)).isoformat()
    root["license"] = _licence(crate, licence)
    root["conformsTo"] = _add(
        crate, PROFILE, "CreativeWork", name="Process Run Crate", version=PROFILE.rpartition("/")[2]
    )
    root["mentions"] = [*actions, *(entities[name] for name in left_out)]
    metadata = json.dumps(crate.metadata.generate(), indent=1, sort_keys=True, ensure_ascii=False) + "\n"
    (_write_zip if zipped else _write_folder)(out, files, metadata.encode())
    return len(files)


def _stage_runs(experiment: ExperimentView) -> list[_StageRun]:
    """Return the stages that made the files of an experiment, in the order of the loop."""
    runs: dict[tuple[str, str, int], _StageRun] = {}
    for context, path in _recorded(experiment):
        folder = context.folder
        lineage, made_by = READERS[path.suffix](path)
        if lineage is None or lineage.stage not in STAGES:  # a raw file
            continue
        key, job = (context.name, lineage.stage, lineage.trial), Job(context, lineage.trial)
        run = runs.setdefault(key, _StageRun(lineage.stage, job, {}))
        run.made_by.update(made_by)
        run.inputs.update(lineage.inputs)
        if path.is_relative_to(folder.results):  # raw files may be copies of results, with their lineage
            run.outputs.add(_name_of(experiment, path))
        run.outputs.update(_name_of(experiment, path.parent / picture) for picture in lineage.pictures)
    for run in runs.values():
        run.inputs.add(_name_of(experiment, experiment.context.file))
        _add_declared(experiment, run)
        run.inputs.difference_update(run.outputs)
    order = list(STAGES)
    return sorted(runs.values(), key=lambda run: (run.job.trial, order.index(run.stage)))


def _recorded(experiment: ExperimentView) -> Iterator[tuple[Context, Path]]:
    """Yield the files with a lineage, of the experiment and of each of several cameras."""
    whole = experiment.context
    for context in (whole, *whole.views.values()):
        folder = context.folder
        places = [folder.results, folder.results / "cameras"]
        places += [folder.trial(number).results for number in experiment.trials]
        if context is whole:
            places += [folder.rehearsal, *(trial.folder.data for trial in experiment.trials.values())]
        for path in sorted(path for place in places for path in place.glob("*.*")):
            if path.suffix in READERS and not path.name.startswith("."):
                yield context, path


def _add_declared(experiment: ExperimentView, run: _StageRun) -> None:
    """Add the files that no lineage names: raw ones that a stage hashes itself, and what the lab films."""
    job, stage = run.job, STAGES[run.stage]
    declared = {**stage.inputs, **stage.may_read}
    read = [path for role in set(declared) - set(stage.lineage_roles()) for path in declared[role](job)]
    # Results that a stage may look at, such as the manifests of later trials, are not what it works on.
    raw = (path for path in read if path.is_relative_to(experiment.context.folder.data))
    run.inputs.update(_name_of(experiment, path) for path in raw)
    run.outputs.update(_name_of(experiment, path) for path in Files(stage, job).all_outputs())


def _files(experiment: ExperimentView, inputs: Iterable[str]) -> dict[str, Path]:
    """Return the files of the crate by their names in it: settings, arm, raw files, results; no logs."""
    context = experiment.context
    folder = context.folder
    found = [context.file, context.arm_file, *(folder.root / name for name in inputs)]
    former = {path.parent for path in folder.results.glob("*/cameras")}  # of cameras that were removed
    former -= {view.folder.results for view in context.views.values()}
    for top in (folder.data, folder.results):
        for place, folders, names in os.walk(top, followlinks=True):  # a large video is often a link
            shown = [name for name in folders if name != "logs" and not name.startswith(".")]
            folders[:] = [name for name in shown if Path(place, name) not in former]
            found += [Path(place, name) for name in names if not name.startswith(".")]
    named = {_name_of(experiment, path): path for path in found if path.is_file()}
    return {name: named[name] for name in in_trial_order(named)}


def _videos(experiment: ExperimentView) -> set[str]:
    videos = (video for trial in experiment.trials.values() for video in trial.folder.videos())
    return {_name_of(experiment, file) for video in videos for file in files_of_video(video)}


def _name_of(experiment: ExperimentView, path: Path) -> str:
    root, path = (Path(os.path.normpath(each.absolute())) for each in (experiment.context.folder.root, path))
    return relative_to(root, path)


def _add(crate: Any, identifier: str, kind: str, **properties: Any) -> Any:
    from rocrate.model import ContextEntity

    there = {name: value for name, value in properties.items() if value is not None}
    return crate.add(ContextEntity(crate, identifier, {"@type": kind, **there}))


def _content(name: str, path: Path) -> dict[str, Any]:
    about = {"name": name, "contentSize": str(path.stat().st_size), "sha256": sha256_file(path)}
    media_type = MEDIA_TYPES.get(path.suffix.lower())
    return about if media_type is None else about | {"encodingFormat": media_type}


def _add_left_out(crate: Any, name: str, path: Path) -> Any:
    text = "Raw video, left out of this crate; a copy of it is the original if its SHA-256 is this one."
    return _add(crate, f"#{quote(name)}", "VideoObject", description=text, **_content(name, path))


def _add_actions(crate: Any, runs: list[_StageRun], entities: dict[str, Any]) -> list[Any]:
    groups = group_by_versions((run.name, run.made_by) for run in runs if run.made_by)
    software = {name: _add_software(crate, group, groups) for group in groups for name in group.files}
    actions = []
    for run in runs:
        # Pages hold no versions. If all records have the same ones, these made the pages too.
        common = groups[0] if len(groups) == 1 else VersionGroup(versions={}, files=[])
        instrument = software.get(run.name) or _add_software(crate, common, groups)
        properties = {"name": run.name, "instrument": instrument}
        properties["object"] = [entities[name] for name in in_trial_order(run.inputs) if name in entities]
        properties["result"] = [entities[name] for name in in_trial_order(run.outputs) if name in entities]
        actions.append(_add(crate, f"#{run.named('-', '{:02d}')}", "CreateAction", **properties))
    return actions


def _add_software(crate: Any, group: VersionGroup, groups: list[VersionGroup]) -> Any:
    """Add strandcast as one set of versions describes it, once."""
    versions = dict(group.versions)
    number = "" if not versions or len(groups) == 1 else f"-{groups.index(group) + 1}"
    identifier = f"#strandcast{number}"
    if (there := crate.get(identifier)) is not None:
        return there
    own = versions.pop("strandcast", None)
    libraries = [
        crate.get(each) or _add(crate, each, "SoftwareApplication", name=name, softwareVersion=version)
        for name, version in versions.items()
        for each in [f"#{name}-{version}"]
    ]
    return _add(
        crate,
        identifier,
        "SoftwareApplication",
        name="strandcast",
        softwareVersion=own,
        softwareRequirements=libraries or None,
    )


def _description(experiment: ExperimentView, left_out: dict[str, Path]) -> str:
    verdicts = [t.folder.results / "verdict.json" for t in experiment.trials.values()]
    hits = [hit for path in verdicts if path.is_file() and (hit := Verdict.read(path).hit) is not None]
    throws = len(experiment.context.folder.thrown_trials())
    parts = [
        "Throws of a string by a robot arm: recordings, settings, results, provenance.",
        f"Throws: {throws}; at a target: {len(hits)}; hits: {sum(hits)}.",
    ]
    page = experiment.context.folder.results / "report.html"
    if page.is_file():
        parts.append(f"Start with {_name_of(experiment, page)}.")
    if experiment.settings.lab is not None:
        parts.append("Simulated data: the virtual lab of strandcast threw and recorded the string.")
    if left_out:
        parts.append(f"Raw video files left out, with their SHA-256: {len(left_out)}.")
    return " ".join(parts)


def _newest_day(experiment: ExperimentView) -> date:
    raw = (path for path in experiment.context.folder.data.rglob("*") if path.is_file())
    newest_s = max(path.stat().st_mtime for path in (experiment.context.file, *raw))
    return datetime.fromtimestamp(newest_s, UTC).date()


def _licence(crate: Any, identifier: str | None) -> Any:
    if identifier is None:
        return NO_LICENCE
    return _add(crate, f"https://spdx.org/licenses/{quote(identifier)}", "CreativeWork", name=identifier)


def _write_folder(out: Path, files: dict[str, Path], metadata: bytes) -> None:
    for name, path in files.items():
        with atomic_write(out / name, path.stat().st_size) as temporary:
            shutil.copyfile(path, temporary)
    write_bytes(out / METADATA, metadata)


def _write_zip(out: Path, files: dict[str, Path], metadata: bytes) -> None:
    """Write a zip without compression, which is not the same bytes with every version of zlib."""
    with atomic_write(out) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        archive.writestr(zipfile.ZipInfo(METADATA, ZIP_EPOCH), metadata)
        for name, path in files.items():
            entry = zipfile.ZipInfo(name, ZIP_EPOCH)
            entry.file_size = path.stat().st_size
            with path.open("rb") as source, archive.open(entry, "w") as target:
                shutil.copyfileobj(source, target)
