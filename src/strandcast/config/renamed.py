"""Settings with a new name, or that were dropped: accepted for one version, with a warning."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from ruamel.yaml.comments import CommentedMap

from strandcast.config.align import DRIFT_SD, LATENCY_SD_S
from strandcast.config.camera import OFFSET_SD_M
from strandcast.config.lab import LAB_SIZE_PX, TYPICAL
from strandcast.core.objectives import TOLERANCE_RAD
from strandcast.core.strings import FORCES
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
    instead
        What does the work of a dropped one.
    """

    old: str
    new: str | None
    values: Mapping[Any, Any] = field(default_factory=dict)
    instead: str = ""


@dataclass(frozen=True)
class Merged:
    """Settings of one section that became one, with a list of their values; what was not given has a default.

    `new` may be the first of them, which alone may still stand for a list.
    """

    section: str
    old: tuple[str, ...]
    new: str
    defaults: tuple[Any, ...]


MERGED = (
    Merged("align", ("known_drift", "drift_prior"), "drift", (0.0, DRIFT_SD)),
    Merged("align.led", ("x_m", "y_m"), "place_m", (None, None)),
    Merged("align.led", ("latency_s", "latency_sd_s"), "latency_s", (0.0, LATENCY_SD_S)),
    Merged("cameras.*", ("string_offset_m", "string_offset_sd_m"), "string_offset_m", (0.0, OFFSET_SD_M)),
    Merged("objective", ("direction_rad", "tolerance_rad"), "direction_rad", (None, TOLERANCE_RAD)),
    Merged("lab.camera", ("width_px", "height_px"), "size_px", LAB_SIZE_PX),
)

BOARDS = ("board", "plane.board")
DROPPED = (
    *("schema_version", "track.background_frames", "cameras.*.scale"),
    "lab.led",  # the lab has one where `align.led.place_m` is
    # Calibration recognises them.
    *(f"cameras.*.{board}.{name}" for board in BOARDS for name in ("legacy", "first_id")),
    "objective.tolerance_rad",  # without a direction
    "plan.planner",  # by the method
    *("plan.control_points", "plan.ensemble", "plan.finer", "plan.mesh_refinement", "plan.carry_residual"),
    *("plan.bias_correction", "plan.scatter", "plan.use_servo", "plan.paper"),
    *("estimate.ensemble", "estimate.integrator", "estimate.find_weights"),
    # Of the paper's method, which is one setting.
    *(f"estimate.{name}" for name in ("evaluation", "reading", "free_end", "joints", "paper", "w")),
)
CLAMP_OFFSET_SD_RAD = 0.05  # the former default
# Names of version 0.1, accepted by 0.2.
RENAMED: tuple[Renamed, ...] = (
    Renamed("track.hand", "track.tracker", {"marker": "chain", "pivot": "pendulum"}),
    *(Renamed(name, None) for name in DROPPED),
    *(Renamed(f"cameras.*.{name}", "cameras.*.lens") for name in ("lens_photos", "lens_video", "lens_file")),
    Renamed("plan.screening", None, instead="plan.evaluations is as many"),
    Renamed("plan.disturbances", "plan.disturbances", {"learnt": 1.0}),
    Renamed("estimate.search", "estimate.search", {"cma": "thorough", "evolution": "thorough"}),
)


# How the draws of `lab.scatter` were said before they had one name.
DRAWS = {"heavy_tails": "heavy_tails", "drawn": "unknown_rig"}


class Change(NamedTuple):
    """What was done to a setting of a file.

    Attributes
    ----------
    what
        For a message.
    line, column
        Of its key, from 0.
    new, value
        The present name, None if it was dropped, and the present value, None if it is the same.
    leaves_none
        Whether its section is empty without it.
    added
        A line that the file needs instead.
    """

    what: str
    line: int
    column: int
    new: str | None = None
    value: Any = None
    leaves_none: bool = False
    added: str = ""


def with_new_names(data: CommentedMap, file: Path) -> list[Change]:
    """Give settings their new names in place, and remove dropped ones; line numbers stay those of the file.

    Raises
    ------
    StrandcastError
        SC-F003 a setting is given under both names.
    """
    asked = [
        *_with_method(data, file),
        *_with_forces(data, file),
        *_with_tries(data),
        *_with_clamp(data, file),
        *_with_noise(data, file),
    ]
    changed = (
        _changed(section, change, file)
        for change in RENAMED
        for section in _sections(data, change.old.split(".")[:-1])
        if change.old.split(".")[-1] in section
    )
    merged = [change for each in MERGED for change in _merged(data, each, file)]
    return [*asked, *merged, *(each for each in changed if each is not None)]


def _merged(data: CommentedMap, merged: Merged, file: Path) -> Iterator[Change]:
    """Write settings that became one."""
    for section in _sections(data, merged.section.split(".")):
        given = [name for name in merged.old if name in section]
        if not {*given} - {merged.new}:
            continue
        if merged.new in section and (merged.new not in merged.old or isinstance(section[merged.new], list)):
            raise _both(f"{merged.section}.{given[0]}", f"{merged.section}.{merged.new}", section, file)
        values = [
            section.get(name, default) for name, default in zip(merged.old, merged.defaults, strict=True)
        ]
        if None not in values:
            yield from _replaced(section, merged.section, given, {merged.new: values})


def _replaced(
    section: CommentedMap, path: str, given: Sequence[str], new: dict[str, Any], usually: str = ""
) -> Iterator[Change]:
    """Write settings in the place of those given, in the line of the first; none: it is `usually` so."""
    texts = [f"{name}: {_flow(value)}" for name, value in new.items()]
    now = " and ".join(f"{path}.{text}" for text in texts) or usually
    position, places = list(section).index(given[0]), [section.lc.data[name] for name in given]
    between = ", " if section.fa.flow_style() else f"\n{' ' * places[0][1]}"
    first, _, written = between.join(texts).partition(": ")
    for name in given:
        del section[name]
    for name in reversed(new):
        section.insert(position, name, new[name])
        section.lc.data[name] = places[0]
    as_it_was = all(isinstance(value, CommentedMap) for value in new.values())
    for name, (line, column, *_) in zip(given, places, strict=True):
        what = f"{path}.{name} {f'is now {now}' if now else 'was dropped'}; the next version refuses it"
        if name in new:
            what = f"{path}.{name} is now {_flow(new[name])}"
        is_first, is_last = bool(new) and name == given[0], not section and name == given[-1]
        yield Change(what, line, column, first if is_first else None, None if as_it_was else written, is_last)


def _flow(value: Any) -> str:
    """Return a value in one line of YAML."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{name}: {_flow(one)}' for name, one in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_flow, value))}]"
    return "null" if value is None else str(value)


def _with_method(data: CommentedMap, file: Path) -> list[Change]:
    """Write the paper's search or planner, each a setting of its own before, as `method: paper`."""
    found: list[Change] = []
    paper = "paper" in (data.get("method"), *(node.get("search") for node in _sections(data, ["estimate"])))
    for node in _sections(data, ["plan"]):
        planner = node.get("planner", "")
        if planner and planner != ("paper" if paper else "ensemble") and (paper or "method" in data):
            what = f"plan.planner: {planner} goes by method now, which is another"
            raise _unclear("plan.planner", what, "remove one of them", node, file)
    for path in ("estimate.search", "plan.planner"):
        section, name = path.split(".")
        for node in _sections(data, [section]) if "method" not in data or found else ():
            if node.get(name) == "paper":
                place = node.lc.data.pop(name)
                del node[name]
                what = f"{path}: paper is now method: paper, all of it"
                added = "" if found else "method: paper"
                found.append(Change(what, place[0], place[1], leaves_none=not node, added=added))
                if added:
                    data.insert(0, "method", "paper")
                    data.lc.data["method"] = place
    return found


def _with_tries(data: CommentedMap) -> Iterator[Change]:
    """Write the tries of the paper's planner, which had no other evaluations, as these."""
    for plan in _sections(data, ["plan"]) if data.get("method") == "paper" else ():
        if "screening" in plan:
            given = [name for name in plan if name in ("screening", "evaluations")]
            yield from _replaced(plan, "plan", given, {"evaluations": plan["screening"]})


def _with_forces(data: CommentedMap, file: Path) -> list[Change]:
    """Write the settings that had one force each as `estimate.forces`."""
    changes: list[Change] = []
    for section in _sections(data, ["estimate"]):
        given = {name: section[name] for name in FORCES if name in section}
        if given and "forces" in section:
            raise _both(f"estimate.{next(iter(given))}", "estimate.forces", section, file)
        paper, aimed = data.get("method") == "paper", "target_m" in data
        by_itself = {
            name: "never" if paper else force.throws if aimed else force.captures_in_space
            for name, force in FORCES.items()
        }
        usual = {name for name in FORCES if by_itself[name] == "fitted"}
        usual |= {"drag_along"} if aimed and not paper else set()
        wanted = [name for name in FORCES if given.get(name, name in usual)]
        differs = any(
            (value is True and by_itself[name] != "fitted") or (value is False and by_itself[name] != "never")
            for name, value in given.items()
        )
        new = {"forces": wanted} if differs else {}
        usually = f"estimate.forces: {'paper' if paper else 'auto'}"
        in_order = [name for name in section if name in given]
        changes += _replaced(section, "estimate", in_order, new, usually) if given else []
    return changes


def _with_clamp(data: CommentedMap, file: Path) -> Iterator[Change]:
    """Write whether a turn of the clamp was fitted as its standard deviation."""
    names, target = ("clamp_offset", "clamp_offset_sd_rad"), data.get("target_m")
    usual = CLAMP_OFFSET_SD_RAD if isinstance(target, list) and len(target) == 2 else None
    for section in _sections(data, ["estimate"]):
        if names[0] not in section:
            continue
        fitted, sd = section[names[0]], section.get(names[1], usual)
        if not isinstance(fitted, bool) or (fitted and names[1] not in section and target is None):
            what = f"estimate.clamp_offset: {fitted} does not say how far the clamp may turn"
            fix = "give estimate.clamp_offset_sd_rad alone: 0.05 in the plane, any in space, 0 for no turn"
            raise _unclear("estimate.clamp_offset", what, fix, section, file)
        new = {names[1]: ("any" if sd is None else sd) if fitted else 0}
        yield from _replaced(section, "estimate", [name for name in section if name in names], new)


def _with_noise(data: CommentedMap, file: Path) -> Iterator[Change]:
    """Write the lab's scatter, with what its noise multiplied it by, as `lab.noise` and `lab.draws`."""
    for lab in _sections(data, ["lab"]):
        if "scatter" not in lab or not isinstance(lab["scatter"], CommentedMap | None):
            continue
        scatter, given = dict(lab["scatter"] or {}), [name for name in lab if name in ("noise", "scatter")]
        said = [kind for name, kind in DRAWS.items() if scatter.pop(name, False) is True]
        said += [scatter.pop("draws")] if "draws" in scatter else []
        if len(said) + ("draws" in lab) > 1:
            raise _both("lab.scatter", "lab.draws", lab, file)
        new: dict[str, Any] = {"draws": said[0]} if said else {}
        if scatter:
            new = {"noise": lab["scatter"] if scatter == lab["scatter"] else scatter} | new
        else:
            given = ["scatter"]
        if scatter and "noise" in lab:
            new["noise"] = _multiplied(scatter, lab, file)
        yield from _replaced(lab, "lab", given, new)


def _multiplied(sizes: dict[str, Any], lab: CommentedMap, file: Path) -> dict[str, Any]:
    """Return the sizes of a scatter times the noise beside it."""
    noise, whole = lab["noise"], sizes if lab["noise"] == 1 else TYPICAL | sizes
    for each in (noise, *whole.values()):
        if isinstance(each, bool | str) or not isinstance(each, int | float) or not 0 <= each <= 10:
            fix = "write the standard deviations to lab.noise, by name"
            raise _unclear("lab.scatter", "lab.scatter cannot be multiplied by lab.noise", fix, lab, file)
    return {name: float(noise) * float(size) for name, size in whole.items()}


def _unclear(field: str, what: str, fix: str, section: CommentedMap, file: Path) -> StrandcastError:
    line = section.lc.data[field.split(".")[-1]][0] + 1
    return StrandcastError("SC-F003", what, file=file, line=line, field=field, fix=fix)


def _both(old: str, new: str, section: CommentedMap, file: Path) -> StrandcastError:
    what = f"{old} is the old name of {new}, which is given too"
    return _unclear(old, what, f"remove {old}", section, file)


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


def _changed(section: CommentedMap, change: Renamed, file: Path) -> Change | None:
    """Change one setting of a section; return what was done, if anything."""
    old, value = change.old.split(".")[-1], section[change.old.split(".")[-1]]
    place = section.lc.data[old]
    line, column = place[:2]
    if change.new is None:
        del section[old]
        no_effect = change.instead or "it has no effect"
        what = f"{change.old} was dropped, {no_effect}; the next version refuses it: remove it"
        return Change(what, line, column, leaves_none=not section)
    new = change.new.split(".")[-1]
    known = isinstance(value, str | int | float | bool) and value in change.values
    now = change.values[value] if known else value
    if new == old:
        if not known:
            return None
        section[old] = now
        return Change(f"{change.old}: {value} was dropped; {now} is used: write that", line, column, new, now)
    if new in section:
        raise _both(change.old, change.new, section, file)
    position = list(section).index(old)
    del section[old]
    section.insert(position, new, now)
    section.lc.data[new] = place
    what = f"{change.old} is now called {change.new}; the old name will be refused by the next version"
    return Change(what, line, column, new, now if known else None)
