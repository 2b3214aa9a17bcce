"""Lineage of a file: the experiment, trial and stage that it belongs to, and the hashes of its inputs.

A record or table is written with its lineage. It is refused if it lies in another trial's folder, or if its
inputs have changed since. Contents are hashed, without the versions that made them, so that a result that was
made again with the same numbers still fits.
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Self

from strandcast.core.trial_names import trial_number
from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.files import absolute, content_sha256, sha256_file
from strandcast.records.folders import parted
from strandcast.records.known_hashes import content_sha256_of

KEPT_MOTIONS = "motions"  # the folder of `kept_motions`
MISPLACED, OUTDATED = "SC-R006", "SC-R007"


class Place(NamedTuple):
    """Where a file lies in a project; trial 0: it belongs to the whole experiment."""

    root: Path
    experiment: str
    trial: int
    raw: bool

    def __str__(self) -> str:
        return _named(self.experiment, self.trial)

    @property
    def run(self) -> str:
        """Return the command that makes its results: with a camera, those of the whole experiment."""
        return f"strandcast run {parted(self.experiment)[0]}"


@dataclass(frozen=True)
class Lineage:
    """What a file belongs to and was made from."""

    experiment: str
    trial: int  # 0: the whole experiment
    stage: str = ""  # that wrote it; empty if no stage did
    # Path relative to the project -> hash of the content.
    inputs: dict[str, str] = field(default_factory=dict)
    # Name of a picture that the stage wrote beside the file -> hash of its bytes.
    pictures: dict[str, str] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return plain JSON data, with its hash."""
        data = asdict(self)
        return data | {"sha256": content_sha256(data)}

    @classmethod
    def from_json(cls, data: Any) -> Self:
        """Return the lineage in JSON data, or raise a `ValueError` if it was changed."""
        kinds = {"experiment": str, "trial": int, "stage": str, "inputs": dict, "pictures": dict}
        content: dict[str, Any] = {name: data.get(name) for name in kinds} if isinstance(data, dict) else {}
        if not content or any(type(content[name]) is not kind for name, kind in kinds.items()):
            raise ValueError(f"must have {', '.join(kinds)}")
        if data.get("sha256") != content_sha256(content):
            raise ValueError("was changed")
        return cls(**content)


class _Making(NamedTuple):
    """The stage that is running, the hashes of its inputs, and those of the pictures that it has written."""

    stage: str
    inputs: dict[str, str]
    pictures: dict[Path, str]


_MAKING: ContextVar[_Making] = ContextVar("making")


@contextmanager
def made_by_stage(stage: str, root: Path, inputs: Iterable[Path]) -> Iterator[None]:
    """Give all files that are written within the block this stage and these inputs, hashed here."""
    found = sorted({path for path in inputs if path.is_file()})
    hashes = {relative_to(root, path): content_sha256_of(path) for path in found}
    token = _MAKING.set(_Making(stage, hashes, {}))
    try:
        yield
    finally:
        _MAKING.reset(token)


def lineage_at(path: str | Path) -> Lineage | None:
    """Return the lineage of a file that is written at `path` now; None outside a project's folders."""
    place = place_of(path)
    if place is None:
        return None
    making = _MAKING.get(_Making("", {}, {}))
    beside = {file.name: sha for file, sha in making.pictures.items() if file.parent == Path(path).parent}
    return Lineage(place.experiment, place.trial, making.stage, making.inputs, beside)


def note_picture(path: Path) -> None:
    """Add a picture to the lineage of the records that the running stage still writes beside it."""
    if _MAKING.get(None) is not None:
        _MAKING.get().pictures[path] = sha256_file(path)


def check_picture(path: Path, lineage: Lineage | None) -> None:
    """Check a picture against the lineage of the record beside it.

    Raises
    ------
    StrandcastError
        SC-R001 it is not the picture that was written with the record.
    """
    expected = None if lineage is None else lineage.pictures.get(path.name)
    if expected is not None and sha256_file(path) != expected:
        raise _refusal("SC-R001", path, "is not the picture that was made with the results beside it")


def place_of(path: str | Path) -> Place | None:
    """Return where a file lies in a project: data or results, an experiment, perhaps a trial.

    A kept motion lies nowhere: whatever it was planned from may have changed; so does a rehearsal.
    """
    parents = Path(os.path.normpath(Path(path).absolute())).parents  # not "trial-01/../cameras"
    for experiment, inside, below in zip(parents, [None, *parents], [None, None, *parents], strict=False):
        raw = experiment.parent.name == "data"
        if not raw and experiment.parent.name != "results":
            continue
        number = trial_number(inside.name) if inside is not None else 0
        # What lies elsewhere in an experiment belongs to no project that a folder above may look like.
        if inside is not None and (inside.name == KEPT_MOTIONS or (raw and not number)):
            return None
        if not raw and not number and inside is not None and below is not None:  # results/cable/left/trial-01
            number, is_view = trial_number(below.name), below.name == "cameras"
            name = f"{experiment.name}/{inside.name}" if number or is_view else experiment.name
            return Place(experiment.parent.parent, name, number, raw)
        if not raw or number:
            return Place(experiment.parent.parent, experiment.name, number, raw)
    return None


def how_to_make(path: str | Path) -> str:
    """Return the fix for a file that is not there."""
    place = place_of(path)
    if place is None:
        return "check the path"
    return "copy it there" if place.raw else f"make it first: {place.run}"


def check_lineage(
    path: str | Path, lineage: Lineage | None, *, reusable: bool = False, inputs: bool = True
) -> None:
    """Check that a file that was read lies where it belongs, and that its inputs are those that are there.

    Raw files may be copied to another experiment, to process them with other settings, and they outlive the
    results that they were made from: only a trial's number within its own experiment is checked. Results that
    were copied with them, or with a renamed experiment, are made again. Inputs that
    are missing are not checked; without `inputs` none is, as hashing those of many experiments takes minutes.
    A `reusable` raw file, e.g. the motion of a repeated throw, may lie anywhere.

    Raises
    ------
    StrandcastError
        SC-R006 it belongs to another trial; SC-R007 it was made from another input, or for another
        experiment.
    """
    place = place_of(path)
    if place is None or lineage is None or (place.raw and reusable):
        return
    named = _named(lineage.experiment, lineage.trial)
    if lineage.experiment != place.experiment and not place.raw:
        what = f"was made for {named}, but lies in the folder of {place}"
        raise _refusal(OUTDATED, path, what, f"make it again: {place.run}")
    if lineage.experiment == place.experiment and lineage.trial != place.trial:
        what = f"is of {named}, but lies in the folder of {place}"
        raise _refusal(MISPLACED, path, what, "put back this trial's own file")
    changed = [] if place.raw or not inputs else changed_inputs(place.root, lineage.inputs)
    if changed:
        what = f"was made from another {changed[0]} than the one that is there"
        fix = f"restore {changed[0]}, or make this file again: {place.run}"
        raise _refusal(OUTDATED, path, what, fix)


def changed_inputs(root: Path, recorded: Mapping[str, str]) -> list[str]:
    """Return the files that are there with another content than was recorded."""
    top = absolute(root)
    return [name for name, sha256 in recorded.items() if _is_changed(f"{top}/{name}", sha256)]


def _is_changed(file: str, recorded: str) -> bool:
    try:
        return content_sha256_of(file) != recorded
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
        return False


def relative_to(root: Path, path: Path) -> str:
    """Return a path as lineage names it: relative to the project, with forward slashes."""
    # As text: thousands of paths are named in a run that finds nothing to do.
    whole, folder = absolute(path), f"{absolute(root)}{os.sep}"
    return whole.removeprefix(folder).replace(os.sep, "/") if whole.startswith(folder) else path.name


def _named(experiment: str, trial: int) -> str:
    return f"{experiment} trial {trial}" if trial else experiment


def _refusal(code: str, path: str | Path, what: str, fix: str | None = None) -> StrandcastError:
    return StrandcastError(code, what, file=path, field="lineage", fix=fix, exit_code=INTEGRITY)
