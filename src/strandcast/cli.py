"""The command line: a thin door to the same functions that the rules call."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from strandcast import __version__
from strandcast.errors import ENVIRONMENT, INTERRUPTED, StrandcastError
from strandcast.layout import trial_name
from strandcast.progress import set_context, tell

# Heavy imports live inside the commands: `strandcast judge` must not pay for OpenCV.

app = typer.Typer(
    name="strandcast",
    help="From raw high-speed video and a robot log to fitted string physics, the next throw, and a report.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
bring = typer.Typer(help="Bring in data that was measured elsewhere.", no_args_is_help=True)
app.add_typer(bring, name="import")
hand = typer.Typer(help="Hand over to other programs.", no_args_is_help=True)
app.add_typer(hand, name="export")

ROOT = Path()

PLAY_EXIT_CODES = (
    "Exit codes: 0 dry run passed, or played and logged; 2 refused; 3 no driver, or no answer; "
    "5 stopped softly by the player; 6 stopped by the controller; 7 the log is not whole. See docs/player.md."
)

ExperimentName = Annotated[str, typer.Argument(metavar="EXPERIMENT", help="Its folder's name under data/.")]
TrialNumber = Annotated[int, typer.Argument(metavar="TRIAL", min=1, max=99, help="Counted from 1.")]


def _stage(stage: str, experiment: str, *trial: Any) -> None:
    """Run one stage, telling whose it is."""
    where = f"{experiment} {trial_name(trial[0])}" if trial and isinstance(trial[0], int) else experiment
    set_context(where)
    tell(f"{where} {stage}")
    importlib.import_module(f"strandcast.stages.{stage}").run(ROOT, experiment, *trial)


def main() -> None:
    """Run a command; a user's error is one message and an exit code, never a traceback."""
    try:
        app()
    except StrandcastError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    except OSError as error:
        fix = "mend the path, the rights or the room on the disk"
        problem = StrandcastError("SC-W002", str(error.strerror or error), file=error.filename, fix=fix)
        print(problem, file=sys.stderr)
        sys.exit(ENVIRONMENT)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


@app.callback(invoke_without_command=True)
def about(version: Annotated[bool, typer.Option("--version", help="Tell the version.")] = False) -> None:
    """Tell the version, or go on to a command."""
    if version:
        print(f"strandcast {__version__}")
        raise typer.Exit


@app.command()
def run(
    experiments: Annotated[list[str] | None, typer.Argument(metavar="[EXPERIMENT]...")] = None,
    cores: Annotated[int, typer.Option(min=1, help="Processor cores to use.")] = 2,
) -> None:
    """Make the reports of experiments, and everything that they need (default: all under data/)."""
    from strandcast.workflow import run_experiments

    sys.exit(run_experiments(ROOT, experiments or [], cores))


@app.command()
def paper(
    strings: Annotated[str, typer.Option(help="Only these, e.g. 1,3.")] = "",
    targets: Annotated[str, typer.Option(help="Only these, e.g. 1,2.")] = "",
    methods: Annotated[str, typer.Option(help="Only paper, or only default.")] = "",
    seeds: Annotated[int | None, typer.Option(min=1, max=999, help="How many, from the first on.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Few strings, one seed, little effort.")] = False,
    page_only: Annotated[
        bool, typer.Option("--page-only", help="Throw nothing; make the page from the runs that there are.")
    ] = False,
    cores: Annotated[int, typer.Option(min=1, help="Processor cores to use.")] = 2,
) -> None:
    """Throw the paper's strings in the virtual lab, by its method and by ours; one page tells it all."""
    from strandcast.paper.cases import FILE, cases, load_plan, numbers_in, words_in
    from strandcast.paper.write import write_experiments
    from strandcast.workflow import run_paper

    plan = load_plan(ROOT / FILE)
    chosen = cases(
        plan,
        quick=quick,
        seeds=seeds,
        strings=numbers_in(strings),
        targets=numbers_in(targets),
        methods=words_in(methods),
    )
    if not page_only:
        write_experiments(ROOT, plan, chosen)
    sys.exit(run_paper(ROOT, chosen, cores, page_only))


@app.command()
def check(experiment: ExperimentName) -> None:
    """Check an experiment's file and its arm's file, before anything runs."""
    from strandcast.arm.load import load_arm
    from strandcast.arm.weight import torque_gap
    from strandcast.experiment import find_arm, find_experiment, load_experiment

    path = find_experiment(experiment, ROOT)
    settings = load_experiment(path)
    arm = load_arm(find_arm(settings, path, ROOT))
    shared = {m.id for m in arm.markers} & {m.id for m in settings.camera.plane.markers}
    if shared and arm.marker_dictionary == settings.camera.plane.dictionary:
        fix = "give the plane's markers other ids"
        raise StrandcastError(
            "SC-F006",
            f"ids {sorted(shared)} are the hand's too",
            file=path,
            field="camera.plane.markers",
            fix=fix,
        )
    print(
        f"{path}: fine; string of {settings.string.length_m} m as {settings.string.n} points, arm {arm.name}"
    )
    gap = torque_gap(arm)
    if gap is not None:
        print(f"warning: {gap}")


@app.command()
def setup(experiment: ExperimentName) -> None:
    """Let the lab photograph its calibration boards."""
    _stage("setup", experiment)


@app.command()
def throw(experiment: ExperimentName, trial: TrialNumber) -> None:
    """Let the lab play a planned motion and film the throw."""
    _stage("throw", experiment, trial)


@app.command()
def ingest(experiment: ExperimentName, trial: TrialNumber) -> None:
    """Hash and count the raw files of a trial."""
    _stage("ingest", experiment, trial)


@app.command()
def calibrate(experiment: ExperimentName) -> None:
    """Calibrate the lens and the plane of motion."""
    _stage("calibrate", experiment)


@app.command()
def preview(experiment: ExperimentName, trial: TrialNumber) -> None:
    """Show in seconds what the tracker sees in a few frames of a trial."""
    from strandcast.stages import preview as stage

    for line in stage.run(ROOT, experiment, trial):
        print(line)


@app.command()
def track(experiment: ExperimentName, trial: TrialNumber) -> None:
    """Track the string of a trial as mass points."""
    _stage("track", experiment, trial)


@app.command()
def align(experiment: ExperimentName, trial: TrialNumber) -> None:
    """Set the camera's clock by the robot's."""
    _stage("align", experiment, trial)


@app.command()
def supply(experiment: ExperimentName, trial: TrialNumber) -> None:
    """Take in a track and an alignment that were measured elsewhere."""
    _stage("supply", experiment, trial)


@app.command()
def adopt(experiment: ExperimentName, trial: TrialNumber) -> None:
    """Take in the motion that a real arm has played as the trial's motion."""
    _stage("adopt", experiment, trial)


@app.command()
def judge(experiment: ExperimentName, trial: TrialNumber) -> None:
    """Tell by how much the tip missed the target."""
    _stage("judge", experiment, trial)


@app.command()
def estimate(experiment: ExperimentName, trial: TrialNumber) -> None:
    """Fit the string to the throws so far."""
    _stage("estimate", experiment, trial)


@app.command()
def plan(experiment: ExperimentName, trial: TrialNumber) -> None:
    """Plan the motion of a trial from the trials before it."""
    _stage("plan", experiment, trial)


@app.command()
def report(experiment: ExperimentName, trial: TrialNumber) -> None:
    """Write the page of a trial."""
    _stage("report", experiment, trial)


@app.command()
def summary(
    experiment: ExperimentName,
    trials: Annotated[list[int] | None, typer.Argument(metavar="[TRIAL]...")] = None,
) -> None:
    """Write the page and the summary of an experiment (default: all trials that have a page)."""
    _stage("summary", experiment, trials)


@app.command()
def transfer(
    experiment: ExperimentName,
    fitted: Annotated[list[str] | None, typer.Argument(metavar="[FITTED]...")] = None,
) -> None:
    """Tell how strings that were fitted in other experiments predict the last throw of this one."""
    _stage("transfer", experiment, fitted or [])


@app.command("paper-page")
def paper_page(form: Annotated[str, typer.Argument(metavar="FORM", help="paper or paper-quick.")]) -> None:
    """Write page and summary of the paper's experiment from the runs that there are."""
    _stage("paper_page", form)


@app.command(epilog=PLAY_EXIT_CODES)
def play(
    motion: Annotated[Path, typer.Argument(metavar="MOTION", help="The motion.json to play.")],
    arm: Annotated[Path, typer.Option(help="The arm's file.")],
    out: Annotated[Path, typer.Option(help="The trial's folder of raw files.")],
    live: Annotated[
        bool, typer.Option("--live", help="Move the arm, once the motion's short hash is typed.")
    ] = False,
    confirm: Annotated[
        str | None, typer.Option(metavar="HASH", help="The motion's short hash: move the arm without asking.")
    ] = None,
    time_scale: Annotated[
        float, typer.Option(min=1.0, help="Play the same path so many times slower: first 4, then 2, then 1.")
    ] = 1.0,
    move_to_start: Annotated[bool, typer.Option(help="Move slowly to the start posture first.")] = False,
    settle: Annotated[
        float,
        typer.Option(min=0.0, max=600.0, help="Seconds to wait at the start, for the string to hang still."),
    ] = 0.0,
    hanging: Annotated[
        float | None,
        typer.Option(min=0.0, help="Metres that hang from the hand; by default as the experiment says."),
    ] = None,
    accept_soft_realtime: Annotated[
        bool, typer.Option("--accept-soft-realtime", help="Stream even if the host keeps time badly.")
    ] = False,
) -> None:
    """Check a motion against its arm (a dry run); with --live or --confirm, play and log it."""
    from strandcast.player.rehearsal import Terms
    from strandcast.stages import play as stage

    terms = Terms(
        time_scale=time_scale,
        move_to_start=move_to_start,
        settle_s=settle,
        soft_realtime=accept_soft_realtime,
    )
    done = stage.run(motion, arm, out, terms, hanging, live, confirm)
    if done is not None:
        print(f"{out}: {done.status}, {done.rows} rows at {done.timing.rate_hz:.0f} Hz")


@app.command()
def schema() -> None:
    """Print the JSON schema of experiment.yaml, for editors."""
    from strandcast.experiment import json_schema

    print(json_schema(), end="")


@app.command()
def boards(
    experiment: ExperimentName,
    out: Annotated[Path | None, typer.Option(help="Folder; by default results/EXPERIMENT/boards.")] = None,
    png: Annotated[bool, typer.Option("--png", help="PNG with its resolution instead of PDF.")] = False,
) -> None:
    """Print an experiment's marker boards at true size, one PDF each."""
    from strandcast.stages import boards as stage

    folder = out or Path("results") / experiment / "boards"
    for path in stage.run(ROOT, experiment, folder, "png" if png else "pdf"):
        print(path)


@bring.command("joints")
def import_joints(
    experiment: ExperimentName,
    trial: TrialNumber,
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The robot's CSV, or a ROS bag.")],
    dialect: Annotated[str, typer.Option(help="auto, libfranka, ur_rtde or ur.")] = "auto",
    columns: Annotated[
        Path | None, typer.Option(help="TOML or YAML that names the columns of any other CSV.")
    ] = None,
    joint: Annotated[
        list[str] | None, typer.Option(help="Name of a joint, once for each, from the base on.")
    ] = None,
    degrees: Annotated[bool, typer.Option("--degrees", help="The log's angles are in degrees.")] = False,
    topic: Annotated[str | None, typer.Option(help="A bag's topic, where several tell of joints.")] = None,
    receive: Annotated[
        bool, typer.Option("--receive-time", help="A bag's times of reception, not the headers' stamps.")
    ] = False,
    sync_output: Annotated[
        int | None, typer.Option(min=0, help="Digital output that lights the LED, from a UR's log.")
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Write over an earlier import.")] = False,
) -> None:
    """Bring in a joint log: joints.csv and run.json of a trial."""
    from strandcast.imports.bags import BagChoice
    from strandcast.imports.joints import Reading
    from strandcast.imports.mapping import JointMapping, load_mapping
    from strandcast.stages import import_joints as stage

    mapping = None if columns is None else load_mapping(columns, JointMapping)
    bag = BagChoice(topic, "receive" if receive else "header")
    reading = Reading(dialect, mapping, bag, degrees, sync_output)
    run = stage.run(ROOT, experiment, trial, log, reading, joint or [], replace)
    timing = run.timing
    print(
        f"{run.rows} rows at {timing.rate_hz:.1f} Hz, {len(timing.gaps)} gaps, {timing.duplicates} duplicates"
    )
    if timing.gaps:
        worst = max(timing.gaps, key=lambda gap: gap.duration_s)
        lost = sum(gap.missing for gap in timing.gaps)
        print(
            f"{lost} samples lost; longest gap {1000 * worst.duration_s:.1f} ms after row {worst.index + 1}"
        )
    for warning in run.warnings:
        print(f"warning: {warning}")


@bring.command("track")
def import_track(
    experiment: ExperimentName,
    trial: TrialNumber,
    capture: Annotated[Path, typer.Argument(metavar="CAPTURE", help="CSV, one row per instant.")],
    time: Annotated[str, typer.Option(help="Column of the time.")] = "t",
    hand: Annotated[str, typer.Option(help="Columns of the hand: X,Y or X,Y,ANGLE.")] = "x,y,angle",
    marker: Annotated[
        list[str] | None,
        typer.Option(help="PLACE:X,Y once for each marker on the string, e.g. 0.2:x_mid,z_mid."),
    ] = None,
    angle_sign: Annotated[int, typer.Option(help="-1 where the file's angle grows clockwise.")] = 1,
    angle_offset: Annotated[
        float, typer.Option(help="Direction in which the string leaves the hand where the angle is 0 [rad].")
    ] = 0.0,
    columns: Annotated[Path | None, typer.Option(help="TOML or YAML that says all this instead.")] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Write over an earlier import.")] = False,
) -> None:
    """Bring in motion capture: the track, hand and alignment of a trial without video."""
    from strandcast.imports.mapping import CaptureMapping, capture_mapping_of, load_mapping
    from strandcast.stages import import_track as stage

    if columns is None and not marker:
        raise typer.BadParameter("give --marker PLACE:X,Y for each marker, or --columns FILE")
    if columns is not None:
        mapping = load_mapping(columns, CaptureMapping)
    else:
        turned = {"angle_sign": angle_sign, "angle_offset_rad": angle_offset}
        mapping = capture_mapping_of(time, hand, marker or [], **turned)
    summary = stage.run(ROOT, experiment, trial, capture, mapping, replace)
    print(f"{summary.decoded_frames} instants, {summary.points} mass points")
    for warning in summary.warnings:
        print(f"warning: {warning}")


@hand.command("motion")
def export_motion(
    motion: Annotated[Path, typer.Argument(metavar="MOTION", help="The motion.json to hand over.")],
    kind: Annotated[
        str,
        typer.Option("--as", help="ros, ros1, csv or urscript; ros-start, ros1-start: the way to the start."),
    ],
    out: Annotated[Path, typer.Option(help="The file; a goal is JSON, with comments if named .yaml.")],
    arm: Annotated[Path | None, typer.Option(help="The arm's file; by default the experiment's arm.")] = None,
    hanging: Annotated[
        float | None,
        typer.Option(min=0, help="What hangs from the hand [m]; by default the experiment's string."),
    ] = None,
    time_scale: Annotated[float, typer.Option(help="How many times slower: 4 first, then 2, then 1.")] = 1.0,
    rate: Annotated[
        float | None, typer.Option(help="Rows per second of csv (default: as planned) or urscript (500).")
    ] = None,
    sync_output: Annotated[
        int | None, typer.Option(help="urscript: a digital output that is high during the motion.")
    ] = None,
) -> None:
    """Write a motion for an arm without a driver, after the player's checks."""
    from strandcast.exports.export import Form
    from strandcast.player.words import unchecked
    from strandcast.stages import export_motion as stage

    done = stage.run(ROOT, motion, out, Form(kind, rate, sync_output), arm, hanging, time_scale)
    for line in unchecked(done.arm):
        print(line)
    slow = "" if time_scale == 1 else f", {time_scale:g} times slower: not a throw"
    print(f"{out}: motion {done.short_hash}, {done.motion.time_s()[-1]:.3f} s{slow}")
