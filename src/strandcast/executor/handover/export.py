"""Write a motion to a file for an arm that has no driver."""

from dataclasses import dataclass
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.executor.handover.csv_table import table_text
from strandcast.executor.handover.handover import Handover
from strandcast.executor.handover.ros_goal import start_goal, throw_goal
from strandcast.executor.handover.urscript import program_text
from strandcast.records.files import write_text

KINDS = ("ros", "ros1", "ros-start", "ros1-start", "csv", "urscript")


@dataclass(frozen=True)
class ExportForm:
    """The format of an exported motion.

    Attributes
    ----------
    kind
        ``ros`` (ROS 2) or ``ros1``: a FollowJointTrajectory goal; ``ros-start``, ``ros1-start``: the goal
        that brings the arm slowly to the motion's start; ``csv``; ``urscript``.
    rate_hz
        Rows per second of a table or a program.
    sync_output
        Digital output of a UR that is high during the motion.
    """

    kind: str
    rate_hz: float | None = None
    sync_output: int | None = None


def export_motion(handover: Handover, form: ExportForm, out: Path) -> None:
    """Write a motion that has passed the preflight.

    A goal is JSON, which YAML readers accept too; with the suffix .yaml or .yml it begins with comments.

    Raises
    ------
    StrandcastError
        SC-W021 unknown format, SC-E004 invalid or too low rate, or an option that the format does not have,
        SC-E005 the output is a folder; and the formats' own errors.
    """
    if form.kind not in KINDS:
        raise StrandcastError(
            "SC-W021", f"there is no format {form.kind!r}", field="as", fix=f"one of: {', '.join(KINDS)}"
        )
    if form.rate_hz is not None and not 1.0 <= form.rate_hz <= 1e5:
        raise StrandcastError(
            "SC-E004",
            f"a rate of {form.rate_hz:g} Hz",
            field="rate",
            fix="give rows per second, 1 to 100 000",
        )
    _refuse_unused(form)
    if out.is_dir():
        raise StrandcastError("SC-E005", "is a folder", file=out, field="out", fix="give a file name")
    write_text(out, _text(handover, form, out))


def _refuse_unused(form: ExportForm) -> None:
    """Refuse an option that the format would ignore."""
    for value, option, kinds in (
        (form.rate_hz, "rate", ("csv", "urscript")),
        (form.sync_output, "sync-output", ("urscript",)),
    ):
        if value is not None and form.kind not in kinds:
            raise StrandcastError(
                "SC-E004",
                f"{form.kind} has no {option.replace('-', ' ')}",
                field=option,
                fix=f"leave it out, or export {' or '.join(kinds)}",
            )


def _text(handover: Handover, form: ExportForm, out: Path) -> str:
    if form.kind == "csv":
        return table_text(handover, form.rate_hz)
    if form.kind == "urscript":
        return program_text(handover, form.rate_hz, form.sync_output)
    goal = start_goal if form.kind.endswith("-start") else throw_goal
    text = goal(handover, ros1=form.kind.startswith("ros1"))
    if out.suffix not in (".yaml", ".yml"):
        return text
    return "".join(f"# {line}\n" for line in handover.about()) + text
