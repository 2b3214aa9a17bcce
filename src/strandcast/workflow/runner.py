"""Run the workflow for the user: check what is there, run Snakemake, and return what happened."""

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from strandcast.config.find import overlooked_experiments
from strandcast.core.trial_names import trial_name
from strandcast.errors import ENVIRONMENT, INTEGRITY, StrandcastError
from strandcast.records.estimate import UNDER_PREVIOUS, Estimate
from strandcast.records.folders import ExperimentFolder, is_project, trial_folders
from strandcast.records.known_hashes import remembered
from strandcast.records.summary import ExperimentSummary, TrialSummary, miss_in_words
from strandcast.report.campaign import CampaignTally
from strandcast.report.expected import expected_miss
from strandcast.report.first_screen import readable_motion
from strandcast.stages.context import context_of
from strandcast.stages.producers import recording_advice, to_correct_first
from strandcast.workflow.campaign import write_campaign
from strandcast.workflow.check import runnable, unlogged_trials
from strandcast.workflow.display import Display, display_for
from strandcast.workflow.doctor import check_host
from strandcast.workflow.engine import compiling_ahead, run_snakemake
from strandcast.workflow.events import RunState, StageRun, past_durations
from strandcast.workflow.pages import render_page, render_pages
from strandcast.workflow.pending import changed_raw_files, lost_results
from strandcast.workflow.project import DEFAULT_PROFILE, executor_of, profile
from strandcast.workflow.slurm import SLURM, require_slurm, status_options
from strandcast.workflow.status import is_fresh
from strandcast.workflow.targets import default_experiments, experiment, known_trials, targets_of
from strandcast.workflow.verify import Finding, verify

LEAST_CORES = 2
DAMAGED = ("damaged", "misplaced")
REPLACED = "is not the file that results were made from: what is made again takes it as it is now"


class RunOptions(NamedTuple):
    """How a run is done: at most `jobs` stages at a time on `cores` cores, up to the stage `until`.

    With `report_only`, only pages are made, from the results that there are. With a profile of a cluster,
    `jobs` are the cluster's, and `cores` those of each; None leaves both to the profile.
    """

    cores: int | None = None
    jobs: int | None = None
    until: str | None = None
    dry_run: bool = False
    report_only: bool = False
    profile: str = DEFAULT_PROFILE

    def local_cores(self) -> int:
        """Return the cores that stages use on this computer."""
        return self.cores or max(LEAST_CORES, self.jobs or 0)


class RunResult(NamedTuple):
    """What a run did: its exit code, the jobs that ran or would run and that failed, the damaged files."""

    exit_code: int
    jobs: list[StageRun]
    failed: list[StageRun]
    damaged: dict[str, list[Finding]]
    summaries: list[ExperimentSummary]
    refused: list[StrandcastError]
    campaign: tuple[CampaignTally, Path] | None = None  # what the page of all experiments counts


def command(
    root: Path,
    experiments: list[str],
    options: RunOptions,
    outdated: Iterable[Path] = (),
    lost: Iterable[str] = (),
) -> list[str]:
    """Return the Snakemake command line that makes experiments, and outdated and lost results again."""
    made = [target for name in experiments for target in targets_of(name, options.until, root)]
    targets = dict.fromkeys([*made, *lost])
    again = [path.as_posix() for path in outdated]
    folder = profile(root, options.profile)
    executor = executor_of(root / folder)
    return [
        *("snakemake", *targets, *_limits(options, on_cluster=executor is not None)),
        *(status_options() if executor == SLURM else ()),
        *("--workflow-profile", str(folder)),
        *("--quiet", "rules", "host"),
        # A lease per experiment replaces Snakemake's lock, which the first of two runs to end would remove.
        "--nolock",
        *(("--forcerun", *again) if again else ()),
        *(("--dry-run",) if options.dry_run else ()),
    ]


def _limits(options: RunOptions, on_cluster: bool) -> list[str]:
    """Return the options of Snakemake for cores and jobs; on a cluster, the profile may give them."""
    if on_cluster:
        limits = {"--cores": options.cores, "--jobs": options.jobs}
        return [word for name, limit in limits.items() if limit is not None for word in (name, str(limit))]
    at_once = ("--default-resources", "jobs=1", "--resources", f"jobs={options.jobs}")
    return ["--cores", str(options.local_cores()), *(at_once if options.jobs is not None else ())]


def run_experiments(root: Path, experiments: list[str], options: RunOptions) -> RunResult:
    """Run the workflow, or list what it would run; an experiment that cannot be run stops only itself.

    Results that were changed, or that belong to another trial, are never built upon: their experiment is not
    run, its pages say so, and the exit code is that of damaged files. Where nothing has changed, the engine
    is not started.
    """
    refuse_elsewhere(root)
    names = list(dict.fromkeys(experiments or default_experiments(root)))
    names, refused = runnable(root, names, options.until, raw=not options.report_only)
    overlooked = [] if experiments else overlooked_experiments(root)
    unlogged = [] if options.until else [each for name in names for each in unlogged_trials(root, name)]
    for message in (*map(str, refused), *(each.message("WARNING") for each in (*overlooked, *unlogged))):
        print(message, file=sys.stderr, flush=True)
    if options.report_only:
        return _render_again(root, names, options.local_cores(), refused)
    executor = executor_of(root / profile(root, options.profile))
    if executor == SLURM:
        require_slurm(submits=not options.dry_run)
    check_host(root, names)
    with remembered(root):
        waiting = [
            name for name in names if options.until is not None or not is_fresh(experiment(name, root))
        ]
        findings = {name: verify(root, name, raw=False) for name in waiting}
        for context in (experiment(name, root) for name in waiting):
            for raw in changed_raw_files(context, known_trials(context)[0]):
                print(f"WARNING: {raw} {REPLACED}", file=sys.stderr, flush=True)
    damaged = {
        name: wrong
        for name, found in findings.items()
        if (wrong := [each for each in found if each.state in DAMAGED])
    }
    for name, wrong in damaged.items():
        _report_damage(root, name, wrong, options.dry_run)
    codes = [each.exit_code for each in refused] + [INTEGRITY for _ in damaged]
    sound = [name for name in waiting if name not in damaged]
    state = RunState(past_durations(root, sound))
    if sound:
        outdated = [each.file for name in sound for each in findings[name] if each.state == "outdated"]
        lost: list[str] = []
        for context in (experiment(name, root) for name in sound):
            trials, more = known_trials(context)
            page = context.folder.results / "report.html"
            # Snakemake does not ask for a trial that it does not know of yet if the page is there.
            outdated += [page] if more and page.is_file() else []
            lost += lost_results(context, trials) if options.until is None else []
        line = command(root, sound, options, (path.relative_to(root) for path in outdated), lost)
        display = Display(state) if options.dry_run else display_for(state)
        here = executor is None and not options.dry_run
        with compiling_ahead(options.local_cores() if here else 0, display):
            codes.append(run_snakemake(line, root, display))
    partial = options.dry_run or options.until is not None
    not_made = waiting if sound and codes[-1] != 0 else damaged
    made = [name for name in names if name not in not_made]
    written = [ExperimentFolder(root, name).results / "summary.json" for name in made]
    summaries = [] if partial else [ExperimentSummary.read(path) for path in written]
    codes += [INTEGRITY for summary in summaries if summary.all_unread()]
    campaign = None if partial else write_campaign(root)
    return RunResult(max(codes, default=0), state.seen, state.failed, damaged, summaries, refused, campaign)


def _render_again(root: Path, names: list[str], cores: int, refused: list[StrandcastError]) -> RunResult:
    problems = render_pages(root, names, cores)
    for problem in problems:
        print(problem, file=sys.stderr, flush=True)
    codes = [0, *(each.exit_code for each in refused), *(each.exit_code for each in problems)]
    return RunResult(max(codes), [], [], {}, [], refused, write_campaign(root))


def refuse_elsewhere(root: Path) -> None:
    """Refuse to run outside a project."""
    if not is_project(root):
        what = "no project is here or in the folders above: there is no Snakefile beside config/"
        raise StrandcastError("SC-W001", what, file=root.resolve(), exit_code=ENVIRONMENT)


def _report_damage(root: Path, experiment: str, damaged: list[Finding], dry_run: bool) -> None:
    """Print what is damaged, and make the pages again that show it."""
    trials = [] if dry_run else ExperimentFolder(root, experiment).reported_trials()
    for trial in [*trials, 0] if trials else []:
        render_page(root, (experiment, trial))  # what it says is printed below
    for finding in damaged:
        print(f"{finding.file}: {finding.what}\n        Fix: {finding.fix}", file=sys.stderr)
    print(f"{experiment}: not run, because of the files above; its pages say so", file=sys.stderr)


def table(root: Path, summary: ExperimentSummary) -> list[str]:
    """Return an experiment's trials as lines of text."""
    folder = ExperimentFolder(root, summary.experiment)
    page = folder.results / "report.html"
    target = "no target" if summary.target_m is None else f"target {summary.target_m} m"
    lines = [f"{summary.experiment}: string of {summary.string_length_m:g} m, {target}"]
    for trial in summary.trials:
        if trial.excluded is not None:
            lines.append(f"  trial {trial.trial}: excluded ({trial.excluded})")
            continue
        if summary.target_m is None:
            lines += _fitted(page.parent / trial_name(trial.trial), trial)
            continue
        near = miss_in_words(trial, summary.hit_radius_m)
        fit = "" if trial.E_m is None else f"; fitted to {1000 * trial.E_m:.1f} mm"
        lines.append(f"  trial {trial.trial}: {near}{fit}")
    if summary.target_m is None and not summary.trials:
        lines.append(
            f"  no recording yet; import one: strandcast import track {summary.experiment} 1 FILE.csv"
        )
    if summary.next_motion_sha256 is not None:
        number = summary.trials[-1].trial + 1 if summary.trials else 1
        following = folder.trial(number)
        context = context_of(root, summary.experiment)
        motion = following.results / "motion.json"
        expected = expected_miss(readable_motion(motion))
        step = str(motion) if expected is None else f"{motion}, {expected.likely()}"
        first = to_correct_first(context, number)
        if following.raw_files():  # it was thrown
            step = recording_advice(context, number)
        elif first is not None:
            step = f"{first}; then throw again"
        lines.append(f"  next:   {step}")
    lines.append(f"  report: {page}")
    films = (film for number in trial_folders(folder.data) for film in folder.trial(number).videos())
    return [*lines, *(f"  film:   {film}" for film in films)]


def _fitted(folder: Path, trial: TrialSummary) -> list[str]:
    """Return in words how well a trial without a target was fitted, and predicted before, with warnings."""
    if trial.E_m is None:
        return [f"  trial {trial.trial}: not fitted"]
    estimate = Estimate.read(folder / "estimate.json")
    predicted_m, read = estimate.held_out_m(UNDER_PREVIOUS), estimate.fitted_in_words()
    before = "" if predicted_m is None else f"; {1000 * predicted_m:.1f} mm predicted from the trials before"
    parts = "" if read is None else f"; the fit read {read}"
    line = f"  trial {trial.trial}: fitted to E = {1000 * trial.E_m:.1f} mm{before}{parts}"
    weights = [f"    {w.kind} at {1000 * w.place_m:.0f} mm: {w.words}" for w in estimate.weights]
    weights += [] if (undetermined := estimate.undetermined_in_words()) is None else [f"    {undetermined}"]
    return [line, *weights, *(f"    warning: {warning}" for warning in estimate.warnings)]
