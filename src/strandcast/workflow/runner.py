"""Run the workflow for the user: check what is there, run Snakemake, and end with one table."""

import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from strandcast.config.find import find_experiment
from strandcast.errors import ENVIRONMENT, INTEGRITY, StrandcastError
from strandcast.records.folders import ExperimentFolder, trial_name, video_suffixes
from strandcast.records.summary import ExperimentSummary
from strandcast.stages.run import run_stage
from strandcast.workflow.engine import run_snakemake
from strandcast.workflow.host import check_host
from strandcast.workflow.locks import refuse_if_held
from strandcast.workflow.targets import default_experiments, is_to_be_continued
from strandcast.workflow.verify import Finding, verify

DAMAGED = ("damaged", "misplaced")


def command(experiments: list[str], cores: int, outdated: Iterable[Path] = ()) -> list[str]:
    """Return the Snakemake command line that makes the reports of experiments, and outdated results again."""
    targets = [f"results/{name}/report.html" for name in experiments]
    again = [path.as_posix() for path in outdated]
    return [
        *("snakemake", *targets, "--cores", str(cores)),
        *("--workflow-profile", "workflow/profiles/default"),
        *("--quiet", "rules", "progress", "host"),
        # A lease per experiment replaces Snakemake's lock, which the first of two runs to end would remove.
        "--nolock",
        *(("--forcerun", *again) if again else ()),
    ]


def run_experiments(root: Path, experiments: list[str], cores: int) -> int:
    """Run the workflow, print a table of the trials, and return the exit code.

    Results that were changed, or that belong to another trial, are never built upon: their experiment is not
    run, its pages say so, and the exit code is that of damaged files.
    """
    refuse_elsewhere(root)
    names = experiments or default_experiments(root)
    for name in names:
        find_experiment(name, root)
    check_host(root, names)
    for name in names:
        refuse_if_held(root, name)
    findings = {name: verify(root, name, raw=False) for name in names}
    damaged = [name for name in names if any(each.state in DAMAGED for each in findings[name])]
    for name in damaged:
        _report_damage(root, name, findings[name])
    codes = [INTEGRITY for _ in damaged]
    sound = [name for name in names if name not in damaged]
    if sound:
        outdated = [each.file for name in sound for each in findings[name] if each.state == "outdated"]
        # Snakemake does not ask for a trial that it does not know of yet if the page is there.
        pages = [(name, ExperimentFolder(root, name).results / "report.html") for name in sound]
        outdated += [page for name, page in pages if page.is_file() and is_to_be_continued(name, root)]
        line = command(sound, cores, (path.relative_to(root) for path in outdated))
        codes.append(run_snakemake(line, root))
    if codes[-1] == 0:
        codes += [_print_summary(root, name) for name in sound]
    return max(codes)


def refuse_elsewhere(root: Path) -> None:
    """Refuse to run outside a clone, where there is no workflow."""
    if not (root / "workflow" / "Snakefile").is_file():
        raise StrandcastError(
            "SC-W001",
            "there is no workflow/Snakefile here",
            file=root.resolve(),
            fix="change to the folder that strandcast was cloned into",
            exit_code=ENVIRONMENT,
        )


def _report_damage(root: Path, experiment: str, findings: list[Finding]) -> None:
    """Print what is damaged, and make the pages again that show it."""
    folder = ExperimentFolder(root, experiment)
    trials = folder.reported_trials()
    for trial in trials:
        with suppress(StrandcastError):  # raised after the page is written: it says what is damaged
            run_stage("report", root, experiment, trial)
    if trials:
        with suppress(StrandcastError):
            run_stage("summary", root, experiment, trials=trials)
    for finding in findings:
        if finding.state in DAMAGED:
            print(f"{finding.file}: {finding.what}\n        Fix: {finding.fix}", file=sys.stderr)
    print(f"{experiment}: not run, because of the files above; its pages say so", file=sys.stderr)


def _print_summary(root: Path, experiment: str) -> int:
    """Print the table of an experiment's trials and the places of its films; return the exit code."""
    folder = ExperimentFolder(root, experiment)
    summary = ExperimentSummary.read(folder.results / "summary.json")
    print(table(summary, folder.results / "report.html"))
    files = sorted(folder.data.glob("trial-*/video.*"))
    films = [file for file in files if file.suffix.lower() in video_suffixes()]
    print("".join(f"  film:   {film}\n" for film in films), end="")
    return INTEGRITY if summary.all_unread() else 0


def table(summary: ExperimentSummary, page: Path) -> str:
    """Return an experiment's trials as lines of text."""
    lines = [f"{summary.experiment}: string of {summary.string_length_m:g} m, target {summary.target_m} m"]
    for trial in summary.trials:
        if trial.excluded is not None:
            lines.append(f"  trial {trial.trial}: excluded ({trial.excluded})")
            continue
        verdict = {True: "HIT ", False: "miss", None: "UNKNOWN:"}[trial.hit]
        near = "tip not tracked" if trial.miss_m is None else f"{1000 * trial.miss_m:.1f} mm from the target"
        fit = "" if trial.E_m is None else f"; fitted to {1000 * trial.E_m:.1f} mm"
        lines.append(f"  trial {trial.trial}: {verdict} {near}{fit}")
    if summary.next_motion_sha256 is not None:
        following = trial_name(summary.trials[-1].trial + 1 if summary.trials else 1)
        lines.append(f"  next:   {page.parent / following / 'motion.json'}")
    lines.append(f"  report: {page}")
    return "\n".join(lines)
