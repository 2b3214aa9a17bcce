"""Settings with a new name, or that were dropped: accepted for one version, with a warning."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ruamel.yaml.comments import CommentedMap

from strandcast.errors import StrandcastError

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Renamed:
    """A setting with a new last name, and its values if they changed too, or one that was dropped.

    Attributes
    ----------
    old, new
        Paths in experiment.yaml, e.g. ``plan.finer``, in the same section; no new one: it was dropped; the
        same: values were.
    values
        Old value -> new value; all others stay.
    """

    old: str
    new: str | None
    values: Mapping[Any, Any] = field(default_factory=dict)


# Names of version 0.1, accepted by 0.2.
RENAMED: tuple[Renamed, ...] = (
    Renamed("track.hand", "track.tracker", {"marker": "chain", "pivot": "pendulum"}),
    Renamed("plan.finer", "plan.mesh_refinement"),
    Renamed("plan.carry_residual", "plan.bias_correction"),
    Renamed("plan.scatter", None),
    Renamed("plan.disturbances", "plan.disturbances", {"learnt": 1.0}),
    Renamed("estimate.integrator", None),
    Renamed("estimate.find_weights", None),
    Renamed("estimate.search", "estimate.search", {"cma": "thorough", "evolution": "thorough"}),
)


def with_new_names(data: CommentedMap, file: Path, renamed: tuple[Renamed, ...] | None = None) -> None:
    """Give settings their new names in place, and remove dropped ones; line numbers stay those of the file.

    Raises
    ------
    StrandcastError
        SC-F003 a setting is given under both names.
    """
    for change in RENAMED if renamed is None else renamed:
        *sections, old = change.old.split(".")
        node: Any = data
        for name in sections:
            node = node.get(name) if isinstance(node, CommentedMap) else None
        if not isinstance(node, CommentedMap) or old not in node:
            continue
        place = node.lc.data[old]
        if change.new is None:
            del node[old]
            log.warning(
                "%s:%d: %s was dropped and has no effect; remove it: the next version refuses it",
                *(file, place[0] + 1, change.old),
            )
            continue
        new, value = change.new.split(".")[-1], node[old]
        known = isinstance(value, str | int | float | bool) and value in change.values
        if new == old:
            if known:
                node[old] = change.values[value]
                log.warning(
                    "%s:%d: %s: %s was dropped; %s is used: write that",
                    *(file, place[0] + 1, change.old, value, node[old]),
                )
            continue
        if new in node:
            raise StrandcastError(
                "SC-F003",
                f"{change.old} is the old name of {change.new}, which is given too",
                file=file,
                line=place[0] + 1,
                field=change.old,
                fix=f"remove {change.old}",
            )
        position = list(node).index(old)
        del node[old]
        node.insert(position, new, change.values[value] if known else value)
        node.lc.data[new] = place
        log.warning(
            "%s:%d: %s is now called %s; the old name will be refused by the next version",
            file,
            place[0] + 1,
            change.old,
            change.new,
        )
