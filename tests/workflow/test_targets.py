"""Answers for the rules: the experiments and trials that exist, and the files of each stage."""

import re

import pytest

from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.stages.files import SUPPLIED_FILES
from strandcast.workflow import targets

SETTINGS = "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\n"


@pytest.fixture
def root(tmp_path, monkeypatch):
    """Return a project with a real rig, motion capture and a lab experiment."""
    for name, more in (
        ("rig", "excluded: [{trial: 2, reason: slipped}]\n"),
        ("mocap", ""),
        ("lab-1", "lab: {}\n"),
    ):
        (tmp_path / "data" / name).mkdir(parents=True)
        (tmp_path / "data" / name / "experiment.yaml").write_text(SETTINGS + more)
    (tmp_path / "config" / "arms").mkdir(parents=True)
    (tmp_path / "config" / "arms" / "planar3.toml").write_text("")
    files = [("rig", trial, "video.mp4") for trial in (1, 2, 3)] + [("rig", 1, "motion.json")]
    files += [("mocap", 1, name) for name in SUPPLIED_FILES.values()] + [("mocap", 2, "track.parquet")]
    for name, trial, file in files:
        folder = tmp_path / "data" / name / trial_name(trial)
        folder.mkdir(exist_ok=True)
        (folder / file).touch()
    monkeypatch.chdir(tmp_path)
    forget()
    yield tmp_path
    forget()


def forget() -> None:
    """Forget what was read of experiments."""
    targets.experiment.cache_clear()
    targets.supplied_trials.cache_clear()


def matches(pattern: str, path: str) -> bool:
    whole = rf"results/(?P<experiment>{pattern})/trial-(?P<trial>{targets.TRIAL})/track.json"
    return re.fullmatch(whole, path) is not None


def test_each_experiment_is_one_of_the_named_or_another():
    for names in ([], ["lab-1"], ["lab-1", "lab-2"]):
        named, other = targets.names_pattern(names), targets.other_names_pattern(names)
        for name in ("lab-1", "lab-2", "lab-10", "my-lab-1", "rig"):
            path = f"{name}/trial-01/track.json"
            assert matches(named, f"results/{path}") == (name in names)
            assert matches(other, f"results/{path}") == (name not in names)


def test_experiments_are_of_the_lab_or_real(root):
    assert targets.default_experiments() == ["lab-1", "mocap", "rig"]
    assert targets.lab_experiments() == ["lab-1"]
    assert targets.real_experiments() == ["mocap", "rig"]
    (root / "data" / "lab-1" / "experiment.yaml").write_text("lab: no\n")
    targets.experiment.cache_clear()
    assert targets.lab_experiments() == []  # reported when it is asked for
    with pytest.raises(StrandcastError):
        targets.stage_inputs("ingest", "lab-1", 1)


def test_without_experiments_the_demonstration_is_run(tmp_path):
    assert targets.default_experiments(tmp_path) == ["demo"]


def test_a_supplied_trial_is_registered_and_every_other_is_tracked(root):
    supplied = targets.supplied_trials()
    assert supplied == {"mocap": ["trial-01"]}
    register = targets.experiment_pattern(supplied)
    track = targets.experiment_pattern(supplied, other=True)
    for path, is_supplied in (("mocap/trial-01", True), ("mocap/trial-02", False), ("rig/trial-01", False)):
        assert matches(register, f"results/{path}/track.json") == is_supplied
        assert matches(track, f"results/{path}/track.json") != is_supplied
    assert not matches(track, "results/paper/trial-01/track.json")
    assert not matches(targets.experiment_pattern({}), "results/rig/trial-01/track.json")
    assert matches(targets.experiment_pattern({}, other=True), "results/rig/trial-01/track.json")


def test_a_motion_that_a_real_arm_has_played_is_not_planned_again(root):
    assert targets.played_trials() == {"rig": ["trial-01"]}


def test_no_rule_plans_a_trial_with_raw_files_of_a_real_rig(root):
    """Also without the motion beside the raw files, and in an experiment that ships with the project."""
    (root / "config" / "experiments").mkdir()
    (root / "config" / "experiments" / "shipped.yaml").write_text(SETTINGS)
    (root / "data" / "shipped" / "trial-02").mkdir(parents=True)
    (root / "data" / "shipped" / "trial-02" / "cam.avi").touch()
    (root / "data" / "lab-1" / "trial-01").mkdir()
    (root / "data" / "lab-1" / "trial-01" / "video.mp4").touch()
    thrown = targets.thrown_trials()
    assert thrown == {
        "mocap": ["trial-01", "trial-02"],
        "rig": ["trial-01", "trial-02", "trial-03"],
        "shipped": ["trial-02"],
    }
    plan = targets.experiment_pattern(thrown, other=True)
    planned = ("rig/trial-04", "shipped/trial-01", "lab-1/trial-01")
    assert all(matches(plan, f"results/{path}/track.json") for path in planned)
    for name, trials in thrown.items():
        assert not any(matches(plan, f"results/{name}/{trial}/track.json") for trial in trials)


def test_the_next_motion_is_asked_for_after_an_excluded_trial_but_not_for_one_that_was_thrown(root):
    def next_motion(*trials: int) -> list[str]:
        return targets.stage_inputs("summary", "rig", 0, trials)["next_motion"]

    assert next_motion(1, 2) == []  # trial 3 was thrown, with a motion that nobody knows
    motion = root / "results/rig/trial-03/motion.json"
    motion.parent.mkdir(parents=True)
    motion.touch()
    assert next_motion(1, 2) == ["results/rig/trial-03/motion.json"]  # trial 2 is excluded
    assert next_motion(1, 2, 3) == ["results/rig/trial-04/motion.json"]


def test_an_excluded_trial_is_not_read_by_later_ones(root):
    inputs = targets.stage_inputs("estimate", "rig", 3)
    for role in ("track", "alignment", "hand", "summary"):
        assert [path.split("/")[2] for path in inputs[role]] == ["trial-01", "trial-03"]
    assert inputs["previous"] == ["results/rig/trial-01/ensemble.parquet"]
    assert inputs["motion"] == ["data/rig/trial-01/motion.json"]
    assert inputs["joints"] == inputs["run"] == []
    assert targets.stage_inputs("report", "rig", 2)["results"] == []


@pytest.mark.parametrize(
    ("trials", "read"),
    [
        ("3", [4, 6, 7]),
        ("1", [7]),
        ("7", [1, 2, 3, 4, 6, 7]),
        ("all", [1, 2, 3, 4, 6, 7]),
        ("latest", [1, 2, 3, 4, 6, 7]),  # the servos' response is fitted to more than the latest
    ],
)
def test_a_fit_reads_only_the_newest_trials_and_the_fit_before(root, trials, read):
    settings = SETTINGS + f"excluded: [{{trial: 5, reason: slipped}}]\nestimate: {{trials: {trials}}}\n"
    (root / "data" / "rig" / "experiment.yaml").write_text(settings)
    targets.experiment.cache_clear()
    inputs = targets.stage_inputs("estimate", "rig", 7)
    for role in ("track", "alignment", "hand", "summary"):
        assert [int(path.split("/")[2].removeprefix("trial-")) for path in inputs[role]] == read
    assert inputs["previous"] == ["results/rig/trial-06/ensemble.parquet"]


def test_the_inputs_of_a_fit_do_not_grow_with_the_number_of_trials(root):
    def count(trial: int) -> int:
        return sum(map(len, targets.stage_inputs("estimate", "rig", trial).values()))

    assert count(5) < count(20) == count(1000)


def test_raw_files_of_the_lab_have_names_before_they_exist(root):
    inputs = targets.stage_inputs("ingest", "lab-1", 1)
    assert [path for paths in inputs.values() for path in paths] == [
        f"data/lab-1/trial-01/{name}" for name in ("video.mp4", "joints.csv", "run.json", "motion.json")
    ]
    photos = targets.stage_inputs("calibrate", "lab-1")
    assert [len(photos[role]) for role in ("lens", "plane", "manifest")] == [12, 1, 0]


def test_no_motion_follows_the_last_trial_that_has_a_name(root):
    for trial, following in ((999_998, ["results/rig/trial-999999/motion.json"]), (999_999, [])):
        (root / "data" / "rig" / f"trial-{trial}").mkdir()
        (root / "data" / "rig" / f"trial-{trial}" / "video.mp4").touch()
        assert targets.stage_inputs("report", "rig", trial)["next_motion"] == following


def test_trials_beyond_99_are_in_the_order_of_their_numbers(root):
    more = "excluded: [" + ", ".join(f"{{trial: {k}, reason: none}}" for k in range(3, 99)) + "]\n"
    (root / "data" / "many").mkdir()
    (root / "data" / "many" / "experiment.yaml").write_text(SETTINGS + more)
    numbers = [1, 2, 99, 100, 101]
    for number in reversed(numbers):
        folder = root / "data" / "many" / trial_name(number)
        folder.mkdir()
        for name in SUPPLIED_FILES.values() if number != 100 else ("video.mp4",):
            (folder / name).touch()
    assert targets.trials_of("many", lambda trial: "") == numbers
    assert targets.supplied_trials()["many"] == ["trial-01", "trial-02", "trial-99", "trial-101"]
    assert targets.thrown_trials()["many"] == [trial_name(number) for number in numbers]
    estimated = targets.stage_inputs("estimate", "many", 101)["track"]
    assert estimated == [f"results/many/{trial_name(number)}/track.parquet" for number in numbers]
    pages = targets.stage_inputs("summary", "many", 0, numbers)["pages"]
    assert [path.split("/")[2] for path in pages] == [trial_name(number) for number in numbers]
    assert targets.targets_of("many", "plan")[0] == "results/many/trial-102/motion.json"
    assert targets.targets_of("many", "track")[-1].split("/")[2] == "trial-101"
    register = targets.experiment_pattern(targets.supplied_trials())
    tracks = {number: f"results/many/{trial_name(number)}/track.json" for number in (10, 99, 100, 101)}
    assert [number for number, path in tracks.items() if matches(register, path)] == [99, 101]
    assert not matches(targets.EXPERIMENT, "results/many/trial-0100/track.json")


def test_a_supplied_trial_needs_no_camera(root):
    inputs = targets.stage_inputs("report", "mocap", 1)
    assert not [path for path in inputs["results"] if "camera" in path or "manifest" in path]
    assert inputs["next_motion"] == []


def test_the_trials_of_a_real_experiment_are_those_recorded(root):
    assert targets.trials_of("rig", lambda trial: "") == [1, 2, 3]
    assert targets.trials_of("mocap", lambda trial: "") == [1, 2]


def test_lab_trials_go_on_until_a_hit(root, monkeypatch):
    class Verdict:
        def __init__(self, path):
            self.hit = path == "verdict 03"

    monkeypatch.setattr(targets.Verdict, "read", Verdict)
    assert targets.trials_of("lab-1", lambda trial: f"verdict {trial}") == [1, 2, 3]
    assert targets.trials_of("lab-1", lambda trial: "") == [1, 2, 3, 4, 5]


def test_a_run_until_a_stage_asks_for_what_it_writes(root):
    assert targets.targets_of("rig") == ["results/rig/report.html"]
    wanted = [f"results/rig/trial-{trial}/verdict.json" for trial in ("01", "02", "03")]
    assert targets.targets_of("rig", "score") == wanted
    assert targets.targets_of("rig", "plan") == [
        "results/rig/trial-04/motion.json",
        "results/rig/trial-04/predicted.parquet",
    ]
    assert targets.targets_of("lab-1", "lab-throw")[0].startswith("data/lab-1/trial-01/")
    registered = ["results/mocap/trial-01/track.parquet", "results/mocap/trial-01/alignment.json"]
    assert set(registered) < set(targets.targets_of("mocap", "track"))


def test_a_run_until_a_stage_of_a_trial_is_refused_before_there_is_one(root):
    (root / "data" / "new").mkdir()
    (root / "data" / "new" / "experiment.yaml").write_text(SETTINGS)
    assert targets.targets_of("new", "plan") == [
        "results/new/trial-01/motion.json",
        "results/new/trial-01/predicted.parquet",
    ]
    assert "results/new/cameras/main.json" in targets.targets_of("new", "calibrate")
    with pytest.raises(StrandcastError, match="has no trial yet"):
        targets.targets_of("new", "estimate")


def test_an_unknown_stage_is_refused_with_the_nearest(root):
    with pytest.raises(StrandcastError, match="'trak'") as caught:
        targets.targets_of("rig", "trak", root)
    assert caught.value.fix == "did you mean track?"
