"""Settings with a new name, or that were dropped: accepted for one version, with a warning."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ruamel.yaml.comments import CommentedMap

from strandcast.config.paper import PAPERS
from strandcast.errors import StrandcastError


@dataclass(frozen=True)
class Renamed:
    """A setting with a new last name, and its values if they changed too, or one that was dropped.

    Attributes
    ----------
    old, new
        Paths in experiment.yaml, e.g. ``plan.finer``, in the same section; * is any name. No new one: it was
        dropped; the same: values were.
    values
        Old value -> new value; all others stay.
    """

    old: str
    new: str | None
    values: Mapping[Any, Any] = field(default_factory=dict)


# Names of version 0.1, accepted by 0.2.
RENAMED: tuple[Renamed, ...] = (
    Renamed("track.hand", "track.tracker", {"marker": "chain", "pivot": "pendulum"}),
    Renamed("cameras.*.scale", "cameras.*.scale", {"arc": "tracker"}),
    Renamed("plan.finer", "plan.mesh_refinement"),
    Renamed("plan.carry_residual", None),
    Renamed("plan.bias_correction", None),
    Renamed("plan.scatter", None),
    Renamed("plan.disturbances", "plan.disturbances", {"learnt": 1.0}),
    Renamed("estimate.integrator", None),
    Renamed("estimate.find_weights", None),
    Renamed("estimate.search", "estimate.search", {"cma": "thorough", "evolution": "thorough"}),
)


# Settings of the paper's method, without `method: paper`.
OF_THE_PAPER = tuple(
    Renamed(f"{section}.{name}", None) for section in PAPERS for name in PAPERS[section].model_fields
)


def with_new_names(data: CommentedMap, file: Path, renamed: tuple[Renamed, ...] | None = None) -> list[str]:
    """Give settings their new names in place, and remove dropped ones; line numbers stay those of the file.

    Returns
    -------
    What was changed: a line for each, with its place in the file.

    Raises
    ------
    StrandcastError
        SC-F003 a setting is given under both names.
    """
    asked = _with_method(data)
    changes = (*(RENAMED if renamed is None else renamed), *([] if "method" in data else OF_THE_PAPER))
    changed = (
        found
        for change in changes
        for section in _sections(data, change.old.split(".")[:-1])
        if change.old.split(".")[-1] in section
        for found in _changed(section, change, file)
    )
    return [f"{file}:{line + 1}: {what}" for line, what in (*asked, *changed)]


def _with_method(data: CommentedMap) -> list[tuple[int, str]]:
    """Write the paper's search or planner, each a setting of its own before, as `method: paper`."""
    found: list[tuple[int, str]] = []
    for path in ("estimate.search", "plan.planner"):
        section, name = path.split(".")
        for node in _sections(data, [section]) if "method" not in data or found else ():
            if node.get(name) == "paper":
                found.append((node.lc.data[name][0], f"{path}: paper is now method: paper, all of it"))
                data.insert(0, "method", "paper")
                data.lc.data["method"] = node.lc.data.pop(name)
                del node[name]
    return found


def _sections(node: Any, path: Sequence[str]) -> Iterator[CommentedMap]:
    """Yield the sections at a path, in which * is any name; `camera` is short for `cameras.main`."""
    if not isinstance(node, CommentedMap):
        return
    if not path:
        yield node
    elif path[0] == "*":
        yield from (found for each in node.values() for found in _sections(each, path[1:]))
    else:
        yield from _sections(node.get(path[0]), path[1:])
        if path[0] == "cameras":
            yield from _sections(node.get("camera"), path[2:])


def _changed(section: CommentedMap, change: Renamed, file: Path) -> Iterator[tuple[int, str]]:
    """Change one setting of a section; yield its line, from 0, and what was done, if anything."""
    old, value = change.old.split(".")[-1], section[change.old.split(".")[-1]]
    place = section.lc.data[old]
    if change.new is None:
        del section[old]
        yield place[0], f"{change.old} was dropped and has no effect; remove it: the next version refuses it"
        return
    new = change.new.split(".")[-1]
    known = isinstance(value, str | int | float | bool) and value in change.values
    now = change.values[value] if known else value
    if new == old:
        if known:
            section[old] = now
            yield place[0], f"{change.old}: {value} was dropped; {now} is used: write that"
        return
    if new in section:
        raise StrandcastError(
            "SC-F003",
            f"{change.old} is the old name of {change.new}, which is given too",
            file=file,
            line=place[0] + 1,
            field=change.old,
            fix=f"remove {change.old}",
        )
    position = list(section).index(old)
    del section[old]
    section.insert(position, new, now)
    section.lc.data[new] = place
    yield (
        place[0],
        f"{change.old} is now called {change.new}; the old name will be refused by the next version",
    )
