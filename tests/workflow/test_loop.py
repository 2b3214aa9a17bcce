"""The whole workflow on a small lab experiment: results, reruns, settings, exclusions."""

import errno
import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from tests.faults.small import (
    JOBS,
    NAME,
    OPENED,
    REAL,
    SETTINGS,
    WATCH,
    environment,
    make_project,
    result_hashes,
)
from tests.forked import run_module

from strandcast.core.trial_names import trial_name
from strandcast.records.motion import Motion
from strandcast.records.summary import ExperimentSummary
from strandcast.records.tables import table_sha256
from strandcast.report.summary import summarise
from strandcast.stages.context import context_of
from strandcast.stages.files import SUPPLIED_FILES
from strandcast.stages.run import files_of
from strandcast.workflow import locks
from strandcast.workflow.pages import render_pages
from strandcast.workflow.pending import lost_results, tasks_of
from strandcast.workflow.status import status_of
from strandcast.workflow.targets import known_trials
from strandcast.workflow.verify import verify

RULES = {"report": "report_trial", "summary": "report_experiment"}  # stage -> rule of another name
RIG_TRIAL = "results/rig/trial-01"
FORKED = "."
NOT_SUMMARISED = ("observations.parquet", "markers.parquet")  # read by stages, not by the pages
ESTIMATE_READS = ("alignment.json", "track.json")


def inputs_of(path: Path) -> list[str]:
    """Return what a result was made from, as its lineage says."""
    if not path.is_file() or path.suffix not in (".json", ".parquet"):
        return []
    if path.suffix == ".json":
        lineage = json.loads(path.read_text()).get("lineage", {})
    else:
        lineage = json.loads(pq.read_schema(path).metadata.get(b"lineage", b"{}"))
    return list(lineage.get("inputs", {}))


def undeclared(root: Path, experiment: str) -> set[str]:
    """Return the files under data/, results/ and config/ that stages opened without having declared them."""
    opened: dict[str, set[str]] = {}
    for line in set((root / OPENED).read_text().splitlines()):
        command, path = line.split("\t")
        written_now = ".tmp." in path or (root / path).is_dir()  # flushed to disk by the atomic writer
        if path.startswith(("data/", "results/", "config/")) and not written_now:
            opened.setdefault(command, set()).add(path)
    found = set()
    for command, paths in opened.items():
        stage, name, *trials = command.split()
        if stage == "run" or name != experiment:
            continue
        numbers = [int(number) for number in trials]
        trial = 0 if stage == "summary" else sum(numbers)
        files = files_of(stage.replace("-", "_"), root, experiment, trial, numbers)
        may_read = [file for role in files.stage.may_read for file in files.inputs(role)]
        declared = [files.job.context.file, *files.all_inputs(), *may_read, *files.all_outputs()]
        known = {file.resolve() for file in declared}
        # Reading a result checks that its own inputs are still the same.
        known |= {(root / name).resolve() for file in declared for name in inputs_of(file)}
        found |= {f"{stage}: {path}" for path in paths if (root / path).resolve() not in known}
    return found


def snakemake(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    line = ["snakemake", *arguments, "--cores", "2", "--workflow-profile", "workflow/profiles/default"]
    watched = f"{WATCH}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    variables = environment(PYTHONPATH=watched, STRANDCAST_OPENED_FILES=str(root / OPENED))
    return run_module(root, *line, environment=variables)


def jobs(run: subprocess.CompletedProcess) -> set[str]:
    """Return the names of the rules that a dry run would run, from its table of counts."""
    rows = [line.split() for line in (run.stdout + run.stderr).splitlines()]
    return {row[0] for row in rows if len(row) == 2 and row[1].isdigit() and row[0] != "total"}


def dry(root: Path, edit: tuple[str, str] = ("", "")) -> set[str]:
    """Return the rules that would run again after an edit of the experiment's file; the edit is undone."""
    path = root / "config" / "experiments" / "small.yaml"
    assert edit[0] in SETTINGS
    path.write_text(SETTINGS.replace(*edit) if edit[0] else SETTINGS)
    run = snakemake(root, "results/small/report.html", "--dry-run")
    path.write_text(SETTINGS)
    assert run.returncode == 0, run.stderr
    return jobs(run)


@pytest.fixture(scope="module")
def thrown(finished, tmp_path_factory) -> Path:
    """Return a copy of the finished project, which tests change and restore."""
    return Path(shutil.copytree(finished, tmp_path_factory.mktemp("thrown") / "project"))


def test_every_stage_writes_its_files(thrown):
    trial = thrown / "results" / NAME / "trial-01"
    wanted = ["motion.json", "manifest.json", "observations.parquet", "track.json", "strobe.webp"]
    wanted += ["track.parquet", "markers.parquet", "alignment.json", "hand.parquet", "verdict.json"]
    wanted += ["estimate.json", "ensemble.parquet"]
    wanted += ["simulated.parquet", "lab_truth.parquet", "report.html"]
    assert [name for name in wanted if not (trial / name).stat().st_size] == []
    assert (thrown / "results/small/trial-02/motion.json").is_file()


def test_a_project_may_lie_in_a_folder_of_any_name(thrown, tmp_path):
    """What a shell or a pattern would take apart is quoted everywhere; letters are composed and not."""
    name = "$(touch run) `touch run`; touch run & 'a\" \\ é e\u0301 {x} %s *\n#"
    root = Path(shutil.copytree(thrown, tmp_path / name))
    wanted = [f"results/small/trial-01/{file}" for file in ("verdict.json", "report.html")]
    before = [(root / file).read_bytes() for file in wanted]
    for file in wanted:
        (root / file).unlink()
    run = snakemake(root, *wanted)
    assert run.returncode == 0, run.stderr[-3000:]
    assert [(root / file).read_bytes() for file in wanted] == before
    assert verify(root, NAME) == []
    assert list(tmp_path.rglob("run")) == []


@pytest.mark.thorough
def test_a_folder_whose_name_is_not_utf_8_leaves_no_traceback(thrown, tmp_path):
    root = Path(shutil.copytree(thrown, tmp_path / os.fsdecode(b"lab\xff")))
    (root / "results/small/report.html").unlink()
    run = run_module(root, "strandcast", "run", NAME)
    assert run.returncode == 0, run.stderr[-3000:]
    assert "Traceback" not in run.stderr
    assert (root / "results/small/report.html").is_file()


@pytest.fixture
def copied(thrown, tmp_path) -> Path:
    """Return a copy of the thrown experiment that a test may damage."""
    for folder in ("config", "data", "results"):
        shutil.copytree(thrown / folder, tmp_path / folder)
    return tmp_path


def test_verify_finds_nothing_in_sound_files(copied):
    assert verify(copied, NAME) == []


def test_verify_names_every_file_that_results_were_made_from_and_that_is_gone(copied):
    used = [
        copied / "config" / "arms" / "planar3.urdf",
        copied / "data" / NAME / "trial-01" / "joints.csv",
    ]
    used += (copied / "results" / NAME / "trial-01").glob("*.parquet")
    for path in used:
        if path.name in ("lab_truth.parquet", "simulated.parquet"):
            continue
        whole = path.read_bytes()
        path.unlink()
        found = {(finding.file.name, finding.state) for finding in verify(copied, NAME, raw=False)}
        assert (path.name, "missing") in found
        path.write_bytes(whole)
    assert len(used) >= 7
    assert verify(copied, NAME) == []


def test_verify_names_every_result_that_belongs_to_another_trial(copied):
    folder = copied / "results" / NAME
    names = [
        path.name for path in (folder / "trial-01").iterdir() if path.suffix in (".json", ".parquet", ".html")
    ]
    assert len(names) >= 14
    shutil.rmtree(folder / "trial-02")
    for name in names:
        shutil.copytree(
            folder / "trial-01", folder / "trial-03", ignore=lambda _, found, keep=name: {*found} - {keep}
        )
        (finding,) = [each for each in verify(copied, NAME, raw=False) if each.file.parent.name == "trial-03"]
        assert (finding.file.name, finding.state) == (name, "misplaced")
        assert finding.what == "is of small trial 1, but lies in the folder of small trial 3"
        shutil.rmtree(folder / "trial-03")


@pytest.mark.thorough
def test_verify_finds_every_file_that_was_emptied_or_cut(copied):
    for path in (path for path in (copied / "results" / NAME).rglob("*.*") if path.is_file()):
        if path.parent.name in ("logs", "made"):  # a damaged note makes its stage run again
            continue
        whole = path.read_bytes()
        for size in (0, len(whole) // 2):
            path.write_bytes(whole[:size])
            assert path in {finding.file for finding in verify(copied, NAME, raw=False)}, (path.name, size)
        path.write_bytes(whole)
    assert verify(copied, NAME) == []


@pytest.mark.thorough
def test_verify_finds_a_changed_byte_in_every_file(copied):
    places = ("data/small/trial-01", "results/small/trial-01", "results/small/cameras")
    paths = [path for place in places for path in (copied / place).iterdir() if path.is_file()]
    assert {path.suffix for path in paths} == {".json", ".parquet", ".html", ".webp", ".csv", ".mp4"}
    content = {path: table_sha256(path) for path in paths if path.suffix == ".parquet"}
    silent = []
    for path in paths:
        whole, at = path.read_bytes(), path.stat().st_size * 7 // 8  # beyond the versions in a record's head
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        if not verify(copied, NAME):
            # Some bytes of a table's footer have no meaning: the same numbers are read.
            silent += [] if path.suffix == ".parquet" and table_sha256(path) == content[path] else [path.name]
        path.write_bytes(whole)
    assert silent == []


@pytest.fixture(scope="module")
def twice(thrown, tmp_path_factory) -> Path:
    """Return a copy of the project after a second trial."""
    root = Path(shutil.copytree(thrown, tmp_path_factory.mktemp("twice") / "project"))
    settings = SETTINGS.replace("max_trials: 1", "max_trials: 2\nmin_trials: 2")
    (root / "config" / "experiments" / "small.yaml").write_text(settings)
    run = run_module(root, "strandcast", "run", NAME)
    assert run.returncode == 0, run.stderr[-4000:]
    return root


@pytest.mark.thorough
def test_raised_trials_are_thrown(thrown, twice):
    first, second = (ExperimentSummary.read(root / "results/small/summary.json") for root in (thrown, twice))
    assert [trial.trial for trial in second.trials] == [1, 2]
    assert second.trials[0] == first.trials[0]


def pairs(root: Path, top: str) -> list[tuple[Path, Path]]:
    """Return the files of the first trial, each with the file of the same name of the second."""
    first, second = (root / top / NAME / name for name in ("trial-01", "trial-02"))
    return [(path, second / path.name) for path in sorted(first.iterdir()) if path.is_file()]


@contextmanager
def exchanged(*both: tuple[Path, Path]) -> Iterator[None]:
    """Exchange pairs of files within the block."""

    def exchange() -> None:
        for one, other in both:
            aside = one.with_name(".aside")
            one.rename(aside)
            other.rename(one)
            aside.rename(other)

    exchange()
    try:
        yield
    finally:
        exchange()


def faulty(root: Path) -> set[Path]:
    """Return the files that `verify` finds fault with."""
    return {finding.file for finding in verify(root, NAME)}


def verdicts(root: Path) -> tuple[str, list[bool | None], set[str]]:
    """Return the experiment's verdict, those of its trials, and the files that could not be read."""
    trials = {k: root / "results" / NAME / f"trial-0{k}" for k in (1, 2)}
    given = {"string_length_m": 0.3, "target_m": [0.5, 0.5], "hit_radius_m": 0.02}
    found = summarise(NAME, trials, **given, next_motion=trials[2].with_name("trial-03") / "motion.json")
    return found.verdict, [trial.hit for trial in found.trials], set(found.all_unread())


@pytest.mark.thorough
def test_exchanged_raw_files_of_two_trials_are_named(twice):
    both = pairs(twice, "data")
    names = {"video.mp4", "joints.csv", "run.json", "motion.json", "predicted.parquet"}
    assert {one.name for one, _ in both} == names
    for pair in both:
        with exchanged(pair):
            assert faulty(twice) >= set(pair), pair[0].name
    with exchanged(*both):
        assert faulty(twice) >= {path for pair in both for path in pair if path.name == "run.json"}
    assert faulty(twice) == set()


@pytest.mark.thorough
def test_exchanged_results_of_two_trials_are_named_and_change_no_verdict(twice):
    sound, both = verdicts(twice), pairs(twice, "results")
    assert len(both) >= 15
    for pair in both:
        with exchanged(pair):
            assert faulty(twice) >= set(pair), pair[0].name
            verdict, hits, unread = verdicts(twice)
            assert verdict in (sound[0], "unknown"), pair[0].name
            assert all(now in (hit, None) for now, hit in zip(hits, sound[1], strict=True)), pair[0].name
            if pair[0].suffix != ".html" and pair[0].name not in NOT_SUMMARISED:
                assert {f"trial {k}, {pair[0].name}" for k in (1, 2)} <= unread, pair[0].name
    assert (verdicts(twice), faulty(twice)) == (sound, set())


def test_every_job_of_a_run_is_a_fork_of_one_process(thrown):
    lines = (line.split("\t") for line in (thrown / OPENED).read_text().splitlines())
    commands = {command.removeprefix("stage ") for command, what in lines if what == FORKED}
    forked = {command.split()[0] for command in commands} - {"run"}
    assert forked == {stage.replace("_", "-") for stage, _ in JOBS}


def test_a_run_writes_what_its_jobs_took(thrown):
    places = {path.stem: path for path in (thrown / "results" / NAME).rglob("logs/*.jsonl")}
    assert places.keys() == {stage for stage, _ in JOBS}
    track = json.loads(places["track"].read_text())
    assert 0.0 < track["cpu_time"] < 100 * track["s"]
    assert 100.0 < track["max_rss"] < 2000.0


def test_a_stage_opens_only_the_files_that_it_declares(thrown):
    opened = (thrown / OPENED).read_text()
    assert {f"estimate small 01\tresults/small/trial-01/{name}" for name in ESTIMATE_READS} <= set(
        opened.splitlines()
    )
    assert undeclared(thrown, NAME) == set()


def test_the_summary_contains_the_results(thrown):
    summary = ExperimentSummary.read(thrown / "results" / NAME / "summary.json")
    assert summary.target_m == [0.5, 0.5]
    assert summary.hit_radius_m == 0.02
    (trial,) = summary.trials
    truth = json.loads((thrown / "results/small/trial-01/alignment.json").read_text())
    assert trial.alignment_offset_s == truth["offset_s"]
    assert trial.tracked_fraction > 0.5
    assert 0 < trial.E_m < 0.03


def test_nothing_runs_again_without_a_change(thrown):
    assert dry(thrown) == set()


def test_a_changed_setting_runs_only_what_depends_on_it(thrown):
    search = dry(thrown, ("evaluations: 100", "evaluations: 150"))
    assert search == {"estimate", "plan", "report_trial", "report_experiment"}
    clocks = dry(thrown, ("plan:", "align: {drift: [0.0, 1.0e-4]}\nplan:"))
    assert {"align", "score_lab"} <= clocks
    assert not clocks & {"lab_calibrate", "calibrate", "ingest", "track", "lab_throw"}
    title = dry(thrown, ("A small throw", "Another title"))
    assert title == {"report_trial", "report_experiment"}


def run_small(root: Path, *arguments: str) -> tuple[int, dict]:
    run = run_module(root, "strandcast", "run", NAME, "--json", *arguments)
    return run.returncode, json.loads(run.stdout)


def test_a_dry_run_lists_what_would_run_and_why(thrown):
    path = thrown / "config" / "experiments" / "small.yaml"
    path.write_text(SETTINGS.replace("evaluations: 100", "evaluations: 101"))
    code, printed = run_small(thrown, "--dry-run")
    path.write_text(SETTINGS)
    assert code == 0
    reasons = {job["stage"]: job["reason"] for job in printed["jobs"]}
    assert set(reasons) == {"estimate", "plan", "report", "summary"}
    assert reasons["estimate"] == "estimate.evaluations: 100 → 101"
    assert reasons["plan"].startswith("is made again: ensemble.parquet, estimate.json")


@pytest.mark.thorough
def test_a_run_until_a_stage_makes_no_more_than_that(thrown):
    results = thrown / "results" / NAME
    shutil.copytree(results, thrown / "kept")
    for file in ("trial-01/alignment.json", "trial-01/report.html", "report.html"):
        (results / file).unlink()
    code, printed = run_small(thrown, "--until", "align", "--jobs", "1")
    made = (results / "trial-01/alignment.json").is_file(), (results / "report.html").is_file()
    shutil.rmtree(results)
    shutil.move(thrown / "kept", results)
    assert (code, made) == (0, (True, False))
    assert [job["stage"] for job in printed["jobs"]] == ["align"]


def test_one_stage_of_one_trial_can_be_requested(thrown):
    verdict = thrown / "results" / NAME / "trial-01" / "verdict.json"
    before = verdict.read_bytes()
    verdict.unlink()
    run = snakemake(thrown, "results/small/trial-01/verdict.json")
    assert run.returncode == 0, run.stderr
    assert verdict.read_bytes() == before


@pytest.mark.thorough
def test_an_excluded_trial_shows_its_reason(thrown):
    path = thrown / "config" / "experiments" / "small.yaml"
    path.write_text(SETTINGS + "excluded: [{trial: 1, reason: the string <slipped>}]\n")
    run = snakemake(thrown, "results/small/report.html")
    path.write_text(SETTINGS)
    assert run.returncode == 0, run.stderr
    assert "the string &lt;slipped&gt;" in (thrown / "results/small/report.html").read_text()
    assert "the string &lt;slipped&gt;" in (thrown / "results/small/trial-01/report.html").read_text()
    summary = ExperimentSummary.read(thrown / "results" / NAME / "summary.json")
    assert summary.trials[0].excluded == "the string <slipped>"
    assert summary.hit_trial is None


@pytest.fixture(scope="module")
def rig(thrown, tmp_path_factory) -> Path:
    """Return a project in which the lab's throw is a recording of a real rig."""
    root = Path(shutil.copytree(thrown, tmp_path_factory.mktemp("rig") / "project"))
    shutil.copytree(root / "data" / NAME, root / "data" / "rig")
    (root / "data" / "rig" / "experiment.yaml").write_text(REAL)
    run = snakemake(root, "results/rig/report.html")
    assert run.returncode == 0, run.stderr[-3000:]
    return root


def test_recordings_of_a_real_rig_give_a_report_and_the_next_motion(rig):
    results = rig / "results" / "rig"
    assert len(ExperimentSummary.read(results / "summary.json").trials) == 1
    assert (results / "trial-02" / "motion.json").is_file()
    assert f"estimate rig 01\t{results.relative_to(rig)}/trial-01/track.parquet" in (rig / OPENED).read_text()
    assert undeclared(rig, "rig") == set()
    # A motion that was played is not planned again.
    played = Motion.read(rig / "data" / "rig" / "trial-01" / "motion.json")
    assert Motion.read(results / "trial-01" / "motion.json") == played


AFTER_PLAN = {"plan", "report", "summary"}
AFTER_ESTIMATE = AFTER_PLAN | {"estimate"}
AFTER_ALIGN = AFTER_ESTIMATE | {"align", "score"}
AFTER_TRACK = AFTER_ALIGN | {"track", "reconstruct"}


@pytest.mark.parametrize(
    ("before", "after", "stages"),
    [
        ("A small throw", "Another title", {"report", "summary"}),
        ("hit_radius_m: 0.02", "hit_radius_m: 0.03", AFTER_PLAN | {"score"}),
        ("evaluations: 16", "evaluations: 17", AFTER_PLAN),
        ("evaluations: 100", "evaluations: 150", AFTER_ESTIMATE),
        ("seed: 3", "seed: 4", AFTER_ESTIMATE),
        ("seed: 3", "seed: 3\nobjective: {kind: swing, height_m: 0.6}", AFTER_ESTIMATE | {"score"}),
        ("seed: 3", "seed: 3\nalign: {drift: [0.0, 1.0e-4]}", AFTER_ALIGN),
        ("seed: 3", "seed: 3\ntrack: {tracker: chain}", set()),  # the default
        ("[0.50, 0.50]", "[0.50, 0.51]", AFTER_ESTIMATE | {"score"}),
        ("id: 5, x_m: 1.15", "id: 5, x_m: 1.16", AFTER_TRACK | {"calibrate"}),
    ],
)
def test_a_changed_setting_of_a_recorded_experiment_reruns_what_depends_on_it(
    rig: Path, tmp_path: Path, before: str, after: str, stages: set[str]
) -> None:
    root = Path(shutil.copytree(rig, tmp_path / "project"))
    assert before in REAL
    edited(before, after)(root)
    assert {
        step.stage for step, task in tasks_of(context_of(root, "rig"), [1], {}).items() if task.runs
    } == stages


def edited(*change: str):
    return lambda root: (root / "data/rig/experiment.yaml").write_text(REAL.replace(*change))


def removed(*names: str):
    return lambda root: [(root / "results/rig" / name).unlink() for name in names]


def lengthened(name: str):
    return lambda root: (root / name).write_bytes((root / name).read_bytes() + b"\n# more\n")


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda root: None, {}),
        (
            edited("evaluations: 100", "evaluations: 150"),
            {("estimate", 1): "estimate.evaluations: 100 → 150", ("plan", 2): "after estimate of trial 1"},
        ),
        (
            edited("seed: 3", "seed: 3\nexcluded: [{trial: 1, reason: bad}]"),
            {("trial", 1): "bad", ("plan", 2): "data/rig/trial-01/joints.csv is no longer an input"},
        ),
        (
            lengthened("config/arms/planar3.toml"),
            {
                ("track", 1): "config/arms/planar3.toml changed",
                ("plan", 2): "config/arms/planar3.toml changed",
            },
        ),
        pytest.param(
            lengthened("data/rig/trial-01/joints.csv"),
            {("ingest", 1): "data/rig/trial-01/joints.csv changed"},
            marks=pytest.mark.thorough,
        ),
        (lambda root: (root / "config/arms/planar3.toml").touch(), {}),
        (removed("report.html"), {("summary", 0): "results/rig/report.html is missing"}),
        pytest.param(
            removed("trial-01/estimate.json"),
            {("estimate", 1): f"{RIG_TRIAL}/estimate.json is missing"},
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            removed("trial-01/strobe.webp"),
            {("track", 1): f"{RIG_TRIAL}/strobe.webp is missing"},
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            removed("trial-02/motion.json"),
            {("plan", 2): "results/rig/trial-02/motion.json is missing"},
            marks=pytest.mark.thorough,
        ),
        (
            lambda root: shutil.rmtree(root / RIG_TRIAL),
            {("report", 1): f"{RIG_TRIAL}/report.html is missing", ("summary", 0): "after report of trial 1"},
        ),
        (
            lambda root: (removed("trial-01/track.parquet")(root), edited("0.02", "0.03")(root)),
            {
                ("score", 1): "hit_radius_m: 0.02 → 0.03",
                ("reconstruct", 1): f"{RIG_TRIAL}/track.parquet is missing",
            },
        ),
    ],
)
def test_status_agrees_with_what_a_run_does(rig, tmp_path, monkeypatch, change, why):
    root = Path(shutil.copytree(rig, tmp_path / "project"))
    change(root)
    monkeypatch.chdir(root)
    status, context = status_of(Path(), "rig"), context_of(Path(), "rig")
    lost = lost_results(context, known_trials(context)[0])
    run = snakemake(root, "results/rig/report.html", *lost, "--dry-run")
    assert run.returncode == 0, run.stderr
    stages = {(stage.stage, each.trial): stage for each in status.trials for stage in each.stages}
    assert {RULES.get(name, name) for (name, _), stage in stages.items() if stage.runs} == jobs(run)
    for step, reason in why.items():
        assert reason in [*stages[step].why, f"after {stages[step].after}"]
    assert (status.next_steps[0] == "strandcast run rig") == bool(jobs(run))


@pytest.mark.thorough
def test_snakemakes_own_report_holds_pages_numbers_and_figures(rig, tmp_path, monkeypatch):
    root = Path(shutil.copytree(rig, tmp_path / "project"))
    assert snakemake(root, "results/report.html").returncode == 0
    for name in ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")  # nothing listens there: a request would fail
    run = snakemake(root, "results/report.html", "--report", "whole.html")
    assert run.returncode == 0, run.stderr[-3000:]
    page = (root / "whole.html").read_text()
    found = {
        name: json.loads(re.search(rf"var {name} = (\{{.*\}});\n", page)[1])
        for name in ("categories", "results")
    }
    assert found["categories"] == {
        "All experiments": {"Other": ["results/report.html"]},
        "Calibration": {"rig": ["results/rig/cameras/main.webp"]},
        "Experiments": {"rig": ["results/rig/report.html", "results/rig/summary.json"]},
        "Trials": {"rig": ["results/rig/trial-01/report.html", "results/rig/trial-01/strobe.webp"]},
    }
    shown = found["results"]["results/rig/trial-01/report.html"]
    assert shown["labels"] == {"trial": "01", "content": "trial"}
    assert "Trial 01 of experiment rig: the verdict" in shown["caption"]
    assert not re.search(r"<(script|link|img)[^>]*(src|href)=.http", page)


def lines_of(pages: list[Path]) -> list[bytes]:
    return [line for page in pages for line in page.read_bytes().splitlines()]


@pytest.mark.thorough
def test_the_pages_are_rendered_again_without_any_stage(rig, tmp_path, monkeypatch, capsys):
    root = Path(shutil.copytree(rig, tmp_path / "project"))
    pages = [root / "results" / "rig" / name for name in ("report.html", "trial-01/report.html")]
    before = lines_of(pages)
    pages[1].unlink()
    (root / "data/fresh").mkdir()
    shutil.copy(root / "data/rig/experiment.yaml", root / "data/fresh")
    run = run_module(root, "strandcast", "run", "--report-only", "--json")
    assert run.returncode == 0, run.stderr
    assert lines_of(pages) == before
    assert "fresh has no page yet" in run.stderr
    assert not (root / "results/fresh/report.html").exists()  # Snakemake would take it for a finished one
    campaign = json.loads(run.stdout)["campaign"]
    assert (campaign["done"], campaign["failed"], campaign["left"]) == (2, 0, 0)  # with that of small
    assert "rig/trial-01/report.html" in (root / campaign["page"]).read_text()
    pages[1].unlink()

    def refuse(*given: object, **more: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("strandcast.workflow.pages.ProcessPoolExecutor", refuse)
    monkeypatch.chdir(root)  # pages name the results as the command does
    assert render_pages(Path(), ["rig"], 2) == []
    assert lines_of(pages) == before
    assert "pages are rendered on one core: /dev/shm: Permission denied" in capsys.readouterr().err


@pytest.mark.thorough
def test_a_run_makes_all_missing_results_again(rig, tmp_path):
    root = Path(shutil.copytree(rig, tmp_path / "project"))
    before = result_hashes(root)
    removed("trial-01/report.html")(root)  # nothing is made from it
    assert run_module(root, "strandcast", "run", "rig").returncode == 0
    assert result_hashes(root) == before


def test_raw_files_that_changed_or_are_gone_are_named_before_results_are_made_again(rig, tmp_path):
    root = Path(shutil.copytree(rig, tmp_path / "project"))
    folder = root / "data" / "rig" / "trial-01"
    for path in (folder / "joints.csv", folder / "video.mp4"):
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
    assert {each.file.name for each in verify(root, "rig") if each.state == "damaged"} == {
        "joints.csv",
        "video.mp4",
    }
    run = run_module(root, "strandcast", "run", "rig", "--dry-run")
    assert "WARNING: data/rig/trial-01/video.mp4 is not the file that results were made from" in run.stderr
    shutil.rmtree(folder)
    motion = (root / "results" / "rig" / "trial-01" / "motion.json").read_bytes()
    run = run_module(root, "strandcast", "run", "rig")
    assert run.returncode != 0
    assert "SC-W036" in run.stderr
    assert (root / "results" / "rig" / "trial-01" / "motion.json").read_bytes() == motion


def test_status_waits_for_a_run_that_lives(rig, tmp_path):
    root = Path(shutil.copytree(rig, tmp_path / "project"))
    with locks.lease(root, "rig"):
        (step,) = status_of(root, "rig").next_steps
    assert step.startswith(f"# wait for the run that has not ended: process {os.getpid()} on ")
    assert not any(step.startswith("# wait") for step in status_of(root, "rig").next_steps)


def test_an_imported_track_needs_no_camera_and_no_video(rig, tmp_path):
    root = Path(shutil.copytree(rig, tmp_path / "project"))
    for name in SUPPLIED_FILES.values():
        shutil.copy(root / "results/rig/trial-01" / name, root / "data/rig/trial-01")
    stages = [{stage.stage for stage in trial.stages} for trial in status_of(root, "rig").trials[:2]]
    assert stages[0] == {"summary"}
    assert stages[1] >= {"register_track", "score"}
    assert not stages[1] & {"ingest", "track", "align"}


def test_status_names_the_stage_that_failed_and_why(rig, tmp_path):
    root = Path(shutil.copytree(rig, tmp_path / "project"))
    video = root / "data/rig/trial-01/video.mp4"
    video.write_bytes(video.read_bytes()[:1000])
    assert snakemake(root, "results/rig/report.html").returncode == 1
    stages = {stage.stage: stage for stage in status_of(root, "rig").trials[1].stages}
    assert (stages["ingest"].state, stages["ingest"].code) == ("failed", "SC-V005")
    assert stages["register_motion"].state == "done"


@pytest.mark.thorough
def test_after_the_last_trial_was_excluded_the_next_motion_is_planned(rig, tmp_path):
    root = Path(shutil.copytree(rig, tmp_path / "project"))
    before = Motion.read(root / "results/rig/trial-02/motion.json")
    assert before.provenance.start_string is None  # planned with the fitted string
    assert run_module(root, "strandcast", "exclude", "rig", "1", "--reason", "bad").returncode == 0
    run = snakemake(root, "results/rig/report.html")
    assert run.returncode == 0, run.stderr[-3000:]
    following = Motion.read(root / "results/rig/trial-02/motion.json")
    assert following.provenance.start_string == "ensemble"
    summary = ExperimentSummary.read(root / "results/rig/summary.json")
    assert summary.next_motion_sha256 == following.content_sha256()


def test_trials_beyond_99_are_targets(tmp_path):
    root, numbers = make_project(tmp_path), [1, 2, 99, 100, 101]
    (root / "data" / "many").mkdir(parents=True)
    between = ", ".join(f"{{trial: {number}, reason: none}}" for number in range(3, 99))
    (root / "data" / "many" / "experiment.yaml").write_text(f"{REAL}excluded: [{between}]\n")
    for number in reversed(numbers):
        folder = root / "data" / "many" / trial_name(number)
        folder.mkdir()
        for name in (*SUPPLIED_FILES.values(), "motion.json"):
            (folder / name).touch()
    motions = [f"results/many/{trial_name(number)}/motion.json" for number in (100, 102)]
    run = snakemake(root, *motions, "--dry-run")
    assert run.returncode == 0, run.stderr[-3000:]
    assert {"register_motion", "plan"} <= jobs(run)
    estimated = re.findall(r"many trial (\d+): the string's", run.stdout + run.stderr)
    assert {*estimated} == {"01", "02", "99", "100", "101"}
    assert snakemake(root, "results/many/trial-0100/motion.json", "--dry-run").returncode == 1


def test_an_invalid_setting_is_reported_before_any_job_starts(tmp_path):
    root = make_project(tmp_path)
    path = root / "config" / "experiments" / "small.yaml"
    path.write_text(SETTINGS.replace("length_m: 0.30,", "length_m: 300,").replace("seed:", "sede:"))
    run = snakemake(root, "results/small/report.html")
    assert run.returncode == 2
    assert "small.yaml:2: string.length_m" in run.stderr
    assert "did you mean 'seed'?" in run.stderr
    assert "Traceback" not in run.stderr
    assert not (root / "results").exists() or not list((root / "results").rglob("*.json"))


def test_a_failed_stage_names_stage_file_and_fix(thrown, tmp_path):
    root = Path(shutil.copytree(thrown, tmp_path / "project"))
    video = root / "data" / NAME / "trial-01" / "video.mp4"
    video.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    run = snakemake(root, "results/small/trial-01/manifest.json", "--forcerun", "ingest")
    assert run.returncode == 1
    assert "video.mp4" in run.stderr
    assert "Fix:" in run.stderr
    assert "Error in rule ingest" in run.stderr
