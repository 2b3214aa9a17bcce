"""Commands that move an arm: play, and throw for a sitting at the rig."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from strandcast.cli.common import ROOT, AsJson, ExperimentName, show
from strandcast.errors import StrandcastError

EXIT_CODES = "Exit codes: docs/how-to/play-on-an-arm.md. All checks: docs/reference/executor.md."

MoveToStart = Annotated[bool, typer.Option(help="Move slowly to the first configuration before playing.")]
Settle = Annotated[
    float, typer.Option(min=0.0, max=600.0, help="Seconds to wait at the start until the string hangs still.")
]
SoftRealtime = Annotated[
    bool, typer.Option("--accept-soft-realtime", help="Stream even if the host's timing is poor.")
]


def play(
    motion: Annotated[Path, typer.Argument(metavar="MOTION", help="The motion.json to play.")],
    arm: Annotated[Path, typer.Option(help="The arm's file, or its name in config/arms.")],
    out: Annotated[Path, typer.Option(help="The trial's folder of raw files.")],
    live: Annotated[
        bool, typer.Option("--live", help="Move the arm after the motion's short hash is typed.")
    ] = False,
    confirm: Annotated[
        str | None,
        typer.Option(metavar="HASH", help="The motion's short hash: move the arm without asking for it."),
    ] = None,
    time_scale: Annotated[
        float, typer.Option(min=1.0, help="Play the same path this many times slower: 4, then 2, then 1.")
    ] = 1.0,
    move_to_start: MoveToStart = False,
    settle: Settle = 0.0,
    hanging: Annotated[
        float | None,
        typer.Option(min=0.0, help="Length hanging from the hand [m].  [default: the experiment's string]"),
    ] = None,
    accept_soft_realtime: SoftRealtime = False,
    as_json: AsJson = False,
) -> None:
    """Check a motion against its arm (a dry run); with --live or --confirm, play and log it."""
    from strandcast.executor.preflight import PlayOptions
    from strandcast.stages import play as stage

    options = PlayOptions(
        time_scale=time_scale,
        move_to_start=move_to_start,
        settle_s=settle,
        soft_realtime=accept_soft_realtime,
    )
    if as_json and live and confirm is None:
        raise typer.BadParameter("--json asks nothing: use --confirm HASH instead of --live")
    said: list[str] = []
    say = said.append if as_json else print
    done = stage.run(motion, arm, out, options, hanging, live, confirm, say)
    result: dict[str, Any] = {"motion": motion, "out": out, "played": done is not None, "report": said}
    lines = []
    if done is not None:
        result |= {"status": done.status, "rows": done.rows, "rate_hz": done.timing.rate_hz}
        lines = [f"{out}: {done.status}, {done.rows} rows at {done.timing.rate_hz:.0f} Hz"]
    show(as_json, result, lines)


def throw(
    experiment: ExperimentName,
    move_to_start: MoveToStart = False,
    settle: Settle = 0.0,
    accept_soft_realtime: SoftRealtime = False,
) -> None:
    """Hold a sitting at the rig: play the next motion, wait for its film, judge it, plan, and again.

    The arm moves only after the short hash of the motion has been typed. After Ctrl-C, the same command
    goes on.
    """
    if not sys.stdin.isatty():
        what = "a sitting needs a keyboard: each motion is confirmed by a person"
        fix = "start it in a terminal"
        raise StrandcastError("SC-X012", what, cost="nothing was sent to the arm", fix=fix)
    from strandcast.executor.preflight import PlayOptions
    from strandcast.records.folders import ExperimentFolder
    from strandcast.stages.context import context_of
    from strandcast.workflow.sitting import Sitting, hold
    from strandcast.workflow.terminal import Terminal

    context_of(ROOT, experiment)  # refuses one that does not exist before anything is written

    options = PlayOptions(move_to_start=move_to_start, settle_s=settle, soft_realtime=accept_soft_realtime)
    person = Terminal(ExperimentFolder(ROOT, experiment).results)
    typer.echo(f"page that follows: {person.page}")
    hold(Sitting(ROOT, experiment, options, person))
