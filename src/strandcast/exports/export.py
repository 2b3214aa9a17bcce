"""Write a motion for an arm that has no driver."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.exports.handover import HandOver
from strandcast.exports.ros import start_goal, throw_goal
from strandcast.exports.table import table_text
from strandcast.exports.urscript import program_text
from strandcast.records.files import write_text

KINDS = ("ros", "ros1", "ros-start", "ros1-start", "csv", "urscript")


@dataclass(frozen=True)
class Form:
    """How a motion is written.

    Attributes
    ----------
    kind
        ``ros`` (ROS 2) or ``ros1``: a FollowJointTrajectory goal; ``ros-start``, ``ros1-start``: the goal
        that brings the arm slowly to the motion's start; ``csv``; ``urscript``.
    rate_hz
        Rows per second of a table or a program.
    sync_output
        Digital output of a UR that is high while the motion is played.
    """

    kind: str
    rate_hz: float | None = None
    sync_output: int | None = None


def export_motion(handover: HandOver, form: Form, out: Path) -> None:
    """Write a motion that has passed the player's checks.

    A goal is JSON, which YAML readers take too; named .yaml or .yml it opens with comments.

    Raises
    ------
    StrandcastError
        SC-E002 no such format, SC-E003 a rate that is none or too low, SC-E004 what a format does not have,
        SC-E005 no file's name; what the formats refuse.
    """
    if form.kind not in KINDS:
        raise StrandcastError(
            "SC-E002", f"there is no format {form.kind!r}", field="as", fix=f"one of: {', '.join(KINDS)}"
        )
    if form.rate_hz is not None and not 1.0 <= form.rate_hz <= 1e5:
        raise StrandcastError(
            "SC-E003", f"a rate of {form.rate_hz:g} Hz", field="rate", fix="give rows per second"
        )
    _refuse_unused(form)
    if out.is_dir():
        raise StrandcastError("SC-E005", "is a folder", file=out, field="out", fix="name the file in it")
    write_text(out, _text(handover, form, out))


def _refuse_unused(form: Form) -> None:
    """Refuse a wish that the format would not look at."""
    for wish, option, kinds in (
        (form.rate_hz, "rate", ("csv", "urscript")),
        (form.sync_output, "sync-output", ("urscript",)),
    ):
        if wish is not None and form.kind not in kinds:
            raise StrandcastError(
                "SC-E004",
                f"{form.kind} has no {option.replace('-', ' ')}",
                field=option,
                fix=f"leave it out, or write {' or '.join(kinds)}",
            )


def _text(handover: HandOver, form: Form, out: Path) -> str:
    if form.kind == "csv":
        return table_text(handover, form.rate_hz)
    if form.kind == "urscript":
        return program_text(handover, form.rate_hz, form.sync_output)
    goal = start_goal if form.kind.endswith("-start") else throw_goal
    text = goal(handover, ros1=form.kind.startswith("ros1"))
    if out.suffix not in (".yaml", ".yml"):
        return text
    return "".join(f"# {line}\n" for line in handover.about()) + text
