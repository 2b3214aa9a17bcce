"""What is wrong with an experiment is reported before anything runs: all of it, each with its fix."""

import shutil
from pathlib import Path

import pytest
import typer
from tests.faults.small import REAL

from strandcast.cli import checks
from strandcast.config.find import experiment_named, find_experiment
from strandcast.errors import StrandcastError
from strandcast.workflow import check
from strandcast.workflow.check import check_experiment, runnable, unlogged_trials
from strandcast.workflow.status import status_of

SETTINGS = "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\n"


@pytest.fixture
def root(tmp_path: Path, project_root: Path) -> Path:
    shutil.copytree(project_root / "config", tmp_path / "config")
    write(tmp_path, "data/rig/experiment.yaml", SETTINGS)
    return tmp_path


def write(root: Path, name: str, text: str = "") -> None:
    (root / name).parent.mkdir(parents=True, exist_ok=True)
    (root / name).write_text(text)


def errors(root: Path) -> set[tuple[str, str]]:
    """Return codes and files, relative to the experiment's folder."""
    found = check_experiment(root, "rig").errors
    return {(each.code, str(Path(str(each.file)).relative_to(root / "data/rig"))) for each in found}


def test_everything_that_is_wrong_is_reported_at_once(root: Path) -> None:
    for name in ("trial-1/video.mp4", "trial-02/cam.avi", "trial-02/Joints.csv", "trial-03/video.mp4"):
        write(root, f"data/rig/{name}")
    for name in ("trial-03/video.avi", "trial-03/joints.csv", "trial-04/track.parquet", "trial-05-bad/x"):
        write(root, f"data/rig/{name}")
    assert errors(root) == {
        ("SC-C030", "calibration/lens-*.png"),
        ("SC-C031", "calibration/plane.png"),
        ("SC-R032", "trial-1"),
        ("SC-V020", "trial-02"),
        ("SC-V020", "trial-02/Joints.csv"),
        ("SC-V020", "trial-03"),
        ("SC-V020", "trial-03/run.json"),
        ("SC-V020", "trial-04/track.json"),
        ("SC-V020", "trial-04/alignment.json"),
        ("SC-V020", "trial-04/hand.parquet"),
    }
    write(root, "data/rig/trial-06")
    warnings = check_experiment(root, "rig").warnings
    assert [each.code for each in warnings] == ["SC-R032", "SC-R032"]
    assert [Path(str(each.file)).name for each in warnings] == ["trial-05-bad", "trial-06"]


def test_before_the_first_throw_missing_photos_are_warnings(root: Path) -> None:
    shutil.copy(root / "config/examples/ur5e.yaml", root / "data/rig/experiment.yaml")
    found = check_experiment(root, "rig")
    assert found.errors == []
    assert [each.code for each in found.warnings] == ["SC-C030", "SC-C031"]
    write(root, "data/rig/calibration/plane.png", "no picture")
    assert [code for code, _ in errors(root)] == ["SC-C031"]
    write(root, "data/rig/trial-01/video.mp4")
    assert "SC-C030" in {code for code, _ in errors(root)}


def test_a_string_without_target_or_recording_is_not_asked_for_photos(root: Path) -> None:
    write(root, "data/rig/experiment.yaml", "string: {length_m: 0.3}\n")
    found = check_experiment(root, "rig")
    assert found.errors + found.warnings == []
    assert "no recording yet; import one (strandcast import track)" in found.facts[0]
    assert found.after.startswith("import track")  # a run would make an empty page


def test_an_emptied_record_beside_the_raw_files_is_reported(root: Path) -> None:
    write(root, "data/rig/trial-01/motion.json")
    write(root, "data/rig/trial-01/video.mp4")
    assert ("SC-R001", "trial-01/motion.json") in errors(root)


def test_recordings_that_a_stage_would_refuse_are_reported(root: Path, finished: Path) -> None:
    """A missing joint log was found by `align`, after the whole film had been tracked."""
    shutil.copytree(finished / "data/small", root / "data/rig", dirs_exist_ok=True)
    write(root, "data/rig/experiment.yaml", REAL)
    assert errors(root) == set()
    trial = root / "data/rig/trial-01"
    text, film = (trial / "motion.json").read_text(), (trial / "video.mp4").read_bytes()
    (trial / "motion.json").write_text(text.replace('"trial": 1', '"trial": 2'))
    (trial / "video.mp4").write_bytes(film[: len(film) // 2])
    for name in ("joints.csv", "run.json"):
        (trial / name).unlink()
    [unlogged] = unlogged_trials(root, "rig")
    assert "strandcast import joints rig 1 LOG" in str(unlogged)
    assert errors(root) == {
        ("SC-R001", "trial-01/motion.json"),
        ("SC-V005", "trial-01/video.mp4"),
        ("SC-V020", "trial-01"),
    }


def test_a_missing_trial_between_others_is_refused_with_the_line_that_excludes_it(root: Path) -> None:
    for number in (1, 2, 5):
        write(root, f"data/rig/trial-{number:02d}/video.mp4")
    assert ("SC-W036", "trial-03") in errors(root)
    with pytest.raises(StrandcastError, match="SC-W036") as caught:
        runnable(root, ["rig"])
    line = "excluded: [{trial: 3, reason: not thrown}, {trial: 4, reason: not thrown}]"
    assert str(caught.value.problems[0].fix).endswith(line)
    write(root, "data/rig/experiment.yaml", f"{SETTINGS}{line}\n")
    assert runnable(root, ["rig"], raw=False) == (["rig"], [])


def test_results_of_a_trial_without_its_raw_files_are_refused(root: Path) -> None:
    """The last trial was on a disk that is not mounted: its motion would have been planned again."""
    for number in (1, 2):
        write(root, f"results/rig/trial-{number:02d}/report.html")
    write(root, "data/rig/trial-01/video.mp4")
    (root / "data/rig/trial-02").symlink_to(root / "not-mounted")
    with pytest.raises(StrandcastError, match="SC-W036") as caught:
        runnable(root, ["rig"])
    assert "the results of trial 2 are there, and not its raw files" in str(caught.value)
    found = check_experiment(root, "rig")
    assert ("SC-W036", "trial-02") in {(each.code, Path(str(each.file)).name) for each in found.errors}
    assert "is a link to nothing" in {each.what for each in found.warnings}
    write(root, "data/rig/experiment.yaml", f"{SETTINGS}excluded: [{{trial: 2, reason: lost}}]\n")
    assert runnable(root, ["rig"], raw=False) == (["rig"], [])


def test_fix_goes_on_after_a_file_that_cannot_be_read(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write(root, "data/aaa/experiment.yaml", "string: [\n")
    write(root, "data/rig/experiment.yaml", f"{SETTINGS}plan: {{use_servo: true}}\n")
    monkeypatch.setattr(checks, "ROOT", root)
    with pytest.raises(typer.Exit):
        checks.check(None, fix=True)
    assert "1 former settings written as they are now" in capsys.readouterr().out
    assert "use_servo" not in (root / "data/rig/experiment.yaml").read_text()


def test_the_labs_pictures_have_even_sides(root: Path) -> None:
    write(root, "data/rig/experiment.yaml", f"{SETTINGS}lab: {{camera: {{size_px: [641, 480]}}}}\n")
    assert any("multiple of 2" in each.what for each in check_experiment(root, "rig").errors)


def test_the_papers_results_are_no_experiment(root: Path) -> None:
    with pytest.raises(StrandcastError, match="SC-R032") as caught:
        runnable(root, ["paper"])
    assert "'paper' is not a valid name" in str(caught.value)


@pytest.fixture
def recorded(root: Path, finished: Path) -> Path:
    """Return the folder of a recorded throw of the small experiment, with a picture of the empty scene."""
    folder = Path(shutil.copytree(finished / "data/small", root / "data/rig", dirs_exist_ok=True))
    write(root, "data/rig/experiment.yaml", REAL + "track: {background_picture: calibration/empty.png}\n")
    shutil.copy(folder / "calibration/plane.png", folder / "calibration/empty.png")
    return folder


@pytest.mark.parametrize(
    ("name", "code", "field"),
    [
        ("calibration/plane.png", "SC-C031", "camera.plane_photo"),
        ("calibration/lens-*.png", "SC-C030", "camera.lens"),
        ("calibration/empty.png", "SC-T030", "track.background_picture"),
        ("trial-01/joints.csv", "SC-V020", None),
    ],
)
def test_a_missing_raw_file_stops_a_run_before_it_begins(
    root: Path, recorded: Path, name: str, code: str, field: str | None
) -> None:
    """Snakemake printed a MissingInputException and ran nothing, of other experiments either."""
    assert runnable(root, ["rig"]) == (["rig"], [])
    for path in recorded.glob(name):
        path.unlink()
    with pytest.raises(StrandcastError) as caught:
        runnable(root, ["rig"])
    [found] = caught.value.problems
    assert (found.code, found.file, found.field) == (code, str(recorded / name), field)
    assert found.fix
    assert [str(each) for each in check_experiment(root, "rig").errors] == [str(found)]
    assert runnable(root, ["demo", "rig"])[0] == ["demo"]
    assert runnable(root, ["rig"], raw=False)[0] == ["rig"]  # pages need no raw files
    stages = [stage for each in status_of(root, "rig").trials for stage in each.stages]
    assert {(each.state, *each.why) for each in stages if each.code == code} == {("failed", found.what)}


def test_a_supplied_track_without_its_other_files_is_not_taken_for_a_film(root: Path) -> None:
    write(root, "data/rig/trial-01/track.parquet")
    with pytest.raises(StrandcastError) as caught:
        runnable(root, ["rig"])
    names = {Path(str(each.file)).name for each in caught.value.problems}
    assert names == {"track.json", "alignment.json", "hand.parquet"}


@pytest.mark.parametrize("others", [["plane.jpg"], ["plane-2.png"], ["Plane (2).JPG", "plane.tif"]])
def test_which_of_several_photos_shows_the_plane_is_asked(
    root: Path, recorded: Path, others: list[str]
) -> None:
    """The photo of the default's name was taken, or else the first one by name."""
    for name in others:
        write(root, f"data/rig/calibration/{name}")
    with pytest.raises(StrandcastError, match="SC-C031") as caught:
        runnable(root, ["rig"])
    [found] = caught.value.problems
    assert [str(each) for each in check_experiment(root, "rig").errors] == [str(found)]
    assert all(name in found.what for name in ("plane.png", *others))
    assert "camera.plane_photo: calibration/" in str(found.fix)
    named = REAL.replace("camera:", "camera:\n  plane_photo: calibration/plane.png")
    write(root, "data/rig/experiment.yaml", named)
    assert runnable(root, ["rig"]) == (["rig"], [])


def test_a_hit_radius_that_a_touch_does_not_have_is_mentioned(root: Path) -> None:
    def mentioned() -> bool:
        return any("estimate.contact_radius_m" in fact for fact in check_experiment(root, "rig").facts)

    assert not mentioned()
    write(root, "data/rig/experiment.yaml", SETTINGS + "hit_radius_m: 0.05\n")
    assert mentioned()
    write(
        root,
        "data/rig/experiment.yaml",
        SETTINGS + "hit_radius_m: 0.05\nestimate: {contact_radius_m: 0.02}\n",
    )
    assert not mentioned()


def test_the_fix_of_a_wrong_name_is_the_command_that_renames_it(root: Path) -> None:
    write(root, "data/rig/trial-02/Video of day 2.MP4")
    fixes = [each.fix or "" for each in check_experiment(root, "rig").errors if each.code == "SC-V020"]
    folder = root / "data/rig/trial-02"
    assert fixes == [f"rename it: mv '{folder}/Video of day 2.MP4' {folder}/video.mp4"]


def test_a_misspelt_tracker_and_search_are_reported(root: Path) -> None:
    more = "track: {tracker: chian}\nestimate: {search: descnt}\n"
    write(root, "data/rig/experiment.yaml", SETTINGS + more)
    fixes = [str(each.fix) for each in check_experiment(root, "rig").errors if each.code == "SC-W021"]
    assert [fix.split("?")[0] for fix in fixes] == ["did you mean 'chain'", "did you mean 'descent'"]


def test_a_target_out_of_reach_is_reported_with_the_distance_that_is_lacking(root: Path) -> None:
    write(root, "data/rig/experiment.yaml", SETTINGS.replace("[0.5, 0.5]", "[0.0, 1.5]"))
    [error] = [each for each in check_experiment(root, "rig").errors if each.code == "SC-P002"]
    assert error.file == str(root / "data/rig/experiment.yaml")
    assert "no throw comes nearer than" in str(error)


@pytest.mark.parametrize(("speed_m_s", "warned"), [(0.05, True), (50.0, False)])
def test_a_target_that_the_arms_limits_put_out_of_reach_is_reported_with_their_cost(
    root: Path, monkeypatch: pytest.MonkeyPatch, speed_m_s: float, warned: bool
) -> None:
    monkeypatch.setattr(check, "QUICK_SEARCH", {"evaluations": 64})
    monkeypatch.setattr(check, "LIKELY", 0.2 if warned else 0.0)
    arm = root / "config/arms/planar3.toml"
    arm.write_text(arm.read_text().replace("[limits]", f"[limits]\ntool_speed_m_s = {speed_m_s}"))
    found = check_experiment(root, "rig")
    assert any("within the limits of the whole arm" in each for each in found.facts)
    warnings = [each.what for each in found.warnings if each.code == "SC-P002"]
    assert len(warnings) == warned
    assert all("the limits of the whole arm leave no likely hit" in each for each in warnings)


def test_an_excluded_trial_only_warns(root: Path) -> None:
    write(root, "data/rig/trial-01/cam.avi")
    assert ("SC-V020", "trial-01") in errors(root)
    write(root, "data/rig/experiment.yaml", SETTINGS + "excluded: [{trial: 1, reason: no film}]\n")
    assert ("SC-V020", "trial-01") not in errors(root)


@pytest.mark.parametrize(
    "argument",
    ["rig", "data/rig", "data/rig/", "./results/rig/", "data/rig/experiment.yaml", "data/rig/trial-01"],
)
def test_an_experiment_may_be_named_by_a_path(root: Path, monkeypatch, argument: str) -> None:
    monkeypatch.chdir(root)
    assert experiment_named(argument, Path()) == "rig"
    assert experiment_named("config/experiments/demo.yaml", Path()) == "demo"
    monkeypatch.chdir(root / "data")
    assert experiment_named("rig/", Path("..")) == "rig"
    monkeypatch.chdir(root / "data/rig")
    assert experiment_named(".", Path("../..")) == "rig"
    assert experiment_named("/elsewhere/data/rig", Path("../..")) == "/elsewhere/data/rig"


@pytest.mark.parametrize(
    ("name", "new"), [("Größe 1", "groesse-1"), ("Seil_A", "seil-a"), ("École", "ecole"), ("…", "string-1")]
)
def test_a_folder_with_another_name_is_reported_with_its_renaming(root: Path, name: str, new: str) -> None:
    write(root, f"data/{name}/experiment.yaml", SETTINGS)
    with pytest.raises(StrandcastError, match="SC-R032") as caught:
        find_experiment(name, root)
    assert str(caught.value).endswith(str(root / "data" / new))


@pytest.mark.parametrize("name", ["", ".", "..", "../rig", "rig/.."])
def test_no_folder_but_that_of_an_experiment_is_to_be_renamed(root: Path, name: str) -> None:
    with pytest.raises(StrandcastError, match="SC-R032") as caught:
        find_experiment(name, root)
    assert "mv" not in str(caught.value)


def test_settings_of_another_spelling_are_reported_with_their_renaming(root: Path) -> None:
    write(root, "data/rig-2/Experiment.YML", SETTINGS)
    with pytest.raises(StrandcastError, match="SC-F001") as caught:
        find_experiment("rig-2", root)
    assert str(caught.value).endswith(
        f"mv {root}/data/rig-2/Experiment.YML {root}/data/rig-2/experiment.yaml"
    )


def test_a_bad_experiment_stops_only_itself(root: Path) -> None:
    write(root, "data/bad/experiment.yaml", "string: 3\n")
    write(root, "data/Größe 1/experiment.yaml", SETTINGS)
    write(root, "data/misnamed/experiment.yaml", SETTINGS)
    write(root, "data/misnamed/trial-1/video.mp4")
    sound, refused = runnable(root, ["bad", "Größe 1", "misnamed", "rig"])
    assert sound == ["rig"]
    assert [each.code for each in refused] == ["SC-F003", "SC-R032", "SC-R032"]
    with pytest.raises(StrandcastError) as caught:
        runnable(root, ["bad", "misnamed"])
    assert {"SC-F003", "SC-R032"} <= set(str(caught.value).split())


def test_a_string_much_longer_than_the_arm_is_asked_about(root: Path) -> None:
    asked = "is string.length_m right, in metres?"
    for length_m, count in ((0.3, 0), (5.0, 1)):
        write(root, "data/rig/experiment.yaml", SETTINGS.replace("0.3", str(length_m)))
        assert sum(asked in fact for fact in check_experiment(root, "rig").facts) == count
