"""Commands that exchange data with other programs: import joints and track, export motion."""

from pathlib import Path
from typing import Annotated

import typer

from strandcast.cli.common import ROOT, AsJson, ExperimentName, TrialNumber, complete_trial, show
from strandcast.core.trial_names import LAST_TRIAL
from strandcast.errors import StrandcastError

REHEARSAL = "rehearsal"


def trial_or_rehearsal(argument: str) -> str:
    """Return the argument where it is a trial's number, or the word rehearsal."""
    number = int(argument) if argument.isascii() and argument.isdecimal() else 0
    if argument == REHEARSAL or 1 <= number <= LAST_TRIAL:
        return argument
    raise typer.BadParameter(
        f"{argument!r} is neither a trial's number, from 1 to {LAST_TRIAL}, nor {REHEARSAL!r}"
    )


def complete_point(context: typer.Context, incomplete: str) -> list[str]:
    """Return the bodies and markers of the capture that the command line names, after a place or without."""
    from strandcast.imports.capture_table import read_capture

    captures = context.params.get("captures")
    try:
        names = read_capture(captures[0]).points() if captures else []
    except StrandcastError:
        return []
    place, colon, _ = incomplete.partition(":")
    is_placed = colon and place.replace(".", "", 1).isdecimal()
    found = [f"{place}:{name}" for name in names] if is_placed else names
    return [name for name in found if name.startswith(incomplete)]


def import_joints(
    experiment: ExperimentName,
    trial: Annotated[
        str,
        typer.Argument(
            metavar="TRIAL",
            help="The trial's number, or rehearsal: the motion played without the string.",
            parser=trial_or_rehearsal,
            autocompletion=complete_trial,
        ),
    ],
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The robot's CSV, or a ROS bag.")],
    dialect: Annotated[str, typer.Option(help="auto, libfranka, ur_rtde or ur.")] = "auto",
    columns: Annotated[
        Path | None, typer.Option(help="TOML or YAML file that names the columns of any other CSV.")
    ] = None,
    joint: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Name of a joint; repeat, from the base on.")
    ] = None,
    degrees: Annotated[bool, typer.Option("--degrees", help="The log's angles are in degrees.")] = False,
    topic: Annotated[str | None, typer.Option(help="The topic, if several of a bag contain joints.")] = None,
    receive: Annotated[
        bool, typer.Option("--receive-time", help="Use a bag's receive times instead of the header stamps.")
    ] = False,
    sync_output: Annotated[
        int | None, typer.Option(min=0, help="UR logs: the digital output that switches the LED.")
    ] = None,
    rate: Annotated[
        float | None, typer.Option(min=1, help="Rows per second of a log without a column of the time.")
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Overwrite an earlier import.")] = False,
    as_json: AsJson = False,
) -> None:
    """Import a joint log as joints.csv and run.json of a trial, or of the rehearsal (TRIAL: rehearsal)."""
    from strandcast.imports.joints import Reading
    from strandcast.imports.mapping import JointMapping, load_mapping
    from strandcast.stages import import_joints as stage

    mapping = None if columns is None else load_mapping(columns, JointMapping)
    reading = Reading(dialect, mapping, topic, "receive" if receive else "header", degrees, sync_output, rate)
    number = None if trial == REHEARSAL else int(trial)
    run = stage.run(ROOT, experiment, number, log, reading, joint or [], replace)
    timing = run.timing
    lines = [
        f"{run.rows} rows at {timing.rate_hz:.1f} Hz, {len(timing.gaps)} gaps, {timing.duplicates} duplicates"
    ]
    lost = sum(gap.missing for gap in timing.gaps)
    if timing.gaps:
        worst = max(timing.gaps, key=lambda gap: gap.duration_s)
        longest = f"longest gap {1000 * worst.duration_s:.1f} ms after row {worst.index + 1}"
        lines.append(f"{lost} samples lost; {longest}")
    lines += [f"warning: {warning}" for warning in run.warnings]
    counts = {"rows": run.rows, "rate_hz": timing.rate_hz, "gaps": len(timing.gaps), "lost": lost}
    found = counts | {"duplicates": timing.duplicates, "warnings": run.warnings}
    show(as_json, {"experiment": experiment, "trial": number or REHEARSAL} | found, lines)


def _refuse_beside_columns(context: typer.Context) -> None:
    """Refuse options that belong into the file of --columns and would not count."""
    beside = {"experiment", "trial", "captures", "offset", "columns", "replace", "as_json"}
    sources = {
        option.opts[0]: context.get_parameter_source(str(option.name))
        for option in context.command.params
        if option.name not in beside
    }
    given = [name for name, source in sources.items() if source is not None and source.name != "DEFAULT"]
    if given:
        raise typer.BadParameter(
            f"{', '.join(given)}: write this into the file, which gives all of it", param_hint="--columns"
        )


def import_track(
    context: typer.Context,
    experiment: ExperimentName,
    trial: TrialNumber,
    captures: Annotated[
        list[Path],
        typer.Argument(
            metavar="CAPTURE",
            help="CSV, TSV, TRC, C3D or Parquet with one row per sample; further files are the next trials.",
        ),
    ],
    time: Annotated[
        str | None, typer.Option(help="Column of the time; by default the file's own clock, else t.")
    ] = None,
    hand: Annotated[
        str | None,
        typer.Option(
            help="Columns of the hand: X,Y or X,Y,ANGLE, x,y,angle by default; in space X,Y,Z, or NAME; or "
            "its place, if it rests, in the file's axes and unit: 0.0,0.0,1.2. Of an arm's throw in space: "
            "any place on the hand.",
            autocompletion=complete_point,
        ),
    ] = None,
    marker: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PLACE:X,Y",
            help="PLACE:X,Y of a marker on the string, e.g. 0.2:x_mid,z_mid; in space PLACE:X,Y,Z or "
            "PLACE:NAME; repeat for each marker. PLACE is metres from the hand along the string.",
            autocompletion=complete_point,
        ),
    ] = None,
    angle_sign: Annotated[int, typer.Option(help="-1 if the file's angle grows clockwise.")] = 1,
    angle_offset: Annotated[
        float, typer.Option(help="Direction in which the string leaves the hand at angle 0 [rad].")
    ] = 0.0,
    up: Annotated[
        str | None,
        typer.Option(
            help="In space: the file's axis that points up, if it has another: z, y, x, -z, -y or -x."
        ),
    ] = None,
    length_unit: Annotated[
        str | None, typer.Option(help="m, cm, mm or in, where the file does not say it.")
    ] = None,
    time_unit: Annotated[str | None, typer.Option(help="Unit of --time: s (default), ms, us or ns.")] = None,
    rate: Annotated[
        float | None,
        typer.Option(help="Rows per second, where the file has neither it nor a column of the time."),
    ] = None,
    behind: Annotated[
        str | None,
        typer.Option(
            help="Columns of a point behind the hand, as --hand; the string leaves in the direction from "
            "there. For an orientation as a quaternion or angles, use --columns.",
            autocompletion=complete_point,
        ),
    ] = None,
    far: Annotated[
        str | None,
        typer.Option(
            help="In space: the body that drives the string's other end, as --hand.",
            autocompletion=complete_point,
        ),
    ] = None,
    far_behind: Annotated[str | None, typer.Option(help="… and a point behind it, as --behind.")] = None,
    offset: Annotated[
        float | None,
        typer.Option(
            help="Of an arm's throw in space, without --hand: what to add to the capture's time for that of "
            "the joint log [s]; the capture is then in the frame of the arm's base."
        ),
    ] = None,
    columns: Annotated[
        Path | None,
        typer.Option(help="TOML or YAML file that gives all this instead; docs/how-to/capture-in-space.md."),
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Overwrite an earlier import.")] = False,
    as_json: AsJson = False,
) -> None:
    """Import motion capture as track, hand and alignment of trials without video.

    Names, rate, units and the axis that points up are the file's, if it has them. A capture in the plane of
    motion has two coordinates of each marker, one in space three, and one or two ends of the string driven.
    """
    from strandcast.imports.capture_mapping import CaptureMapping, capture_mapping_of
    from strandcast.imports.capture_table import read_capture
    from strandcast.imports.mapping import load_mapping
    from strandcast.stages import import_track as stage

    if columns is None and not marker:
        there = read_capture(captures[0]).listed()
        raise typer.BadParameter(
            f"give --hand NAME, and --marker PLACE:NAME for each marker, or --columns FILE; "
            f"{captures[0].name} has {there}"
        )
    if columns is not None:
        _refuse_beside_columns(context)
        mapping = load_mapping(columns, CaptureMapping)
    else:
        mapping = capture_mapping_of(
            hand,
            marker or [],
            behind=behind,
            far=far,
            far_behind=far_behind,
            time=time,
            time_unit=time_unit,
            rate_hz=rate,
            length_unit=length_unit,
            up=up,
            angle_sign=angle_sign,
            angle_offset_rad=angle_offset,
        )
    found, lines = [], []
    for number, capture in enumerate(captures, trial):
        summary = stage.run(ROOT, experiment, number, capture, mapping, replace, offset)
        what = "markers in space" if mapping.in_space else "mass points"
        lines.append(f"trial {number}: {summary.decoded_frames} samples, {summary.points} {what}")
        lines += [f"warning: {warning}" for warning in summary.warnings]
        numbers = {"samples": summary.decoded_frames, "points": summary.points}
        found.append({"trial": number, **numbers, "warnings": summary.warnings})
    show(as_json, {"experiment": experiment} | (found[0] if len(found) == 1 else {"trials": found}), lines)


def export_motion(
    motion: Annotated[Path, typer.Argument(metavar="MOTION", help="The motion.json to export.")],
    kind: Annotated[
        str,
        typer.Option(
            "--as", help="ros, ros1, csv or urscript; ros-start, ros1-start: the move to the start."
        ),
    ],
    out: Annotated[
        Path, typer.Option(help="Output file; a goal is JSON, with comments if the name ends in .yaml.")
    ],
    arm: Annotated[Path | None, typer.Option(help="The arm's file.  [default: the experiment's arm]")] = None,
    hanging: Annotated[
        float | None,
        typer.Option(min=0, help="Length hanging from the hand [m].  [default: the experiment's string]"),
    ] = None,
    time_scale: Annotated[
        float, typer.Option(help="Play the same path this many times slower: 4, then 2, then 1.")
    ] = 1.0,
    rate: Annotated[
        float | None,
        typer.Option(help="Rows per second of csv (default: as planned) or urscript (500)."),
    ] = None,
    sync_output: Annotated[
        int | None, typer.Option(help="urscript: the digital output that is high during the motion.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check a motion as the player does and write it for an arm without a driver."""
    from strandcast.executor.dry_run_report import unchecked_limits
    from strandcast.executor.handover.export import ExportForm
    from strandcast.stages import export_motion as stage

    done = stage.run(ROOT, motion, out, ExportForm(kind, rate, sync_output), arm, hanging, time_scale)
    duration_s = done.motion.trajectory().end_s
    unchecked = list(unchecked_limits(done.arm))
    slow = "" if time_scale == 1 else f", {time_scale:g} times slower: not a throw"
    lines = [*unchecked, f"{out}: motion {done.short_hash}, {duration_s:.3f} s{slow}"]
    found = {"file": out, "motion": done.short_hash, "duration_s": duration_s, "time_scale": time_scale}
    show(as_json, found | {"unchecked": unchecked}, lines)
