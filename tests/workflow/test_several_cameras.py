"""One throw filmed by two cameras of one experiment, from the films to the fit and the pages."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.faults.small import OPENED, SETTINGS, WATCH, environment, make_project
from tests.workflow.test_loop import undeclared

import strandcast
from strandcast.config.find import experiment_named
from strandcast.errors import StrandcastError
from strandcast.exports.throw import read_throw
from strandcast.lab import view
from strandcast.records.lineage import place_of
from strandcast.records.manifest import Manifest
from strandcast.records.tables import read_parquet
from strandcast.records.track import TrackSummary, read_track
from strandcast.stages import preview
from strandcast.stages.context import context_of
from strandcast.stages.run import files_of, run_stage
from strandcast.workflow.check import check_experiment, refusal
from strandcast.workflow.pending import tasks_of
from strandcast.workflow.verify import verify

FILM, CABLE = "small", "cable"
TURNS_RAD = {"left": -0.35, "right": 0.3}
RATES_HZ = {"left": 150, "right": 120}
PLANE = SETTINGS[SETTINGS.index("  plane:") : SETTINGS.index("estimate:")]
FITTED = SETTINGS[SETTINGS.index("estimate:") : SETTINGS.index("plan:")]


def filmed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the lab film one throw from two sides, each time with the board's photos by the same camera."""
    root = make_project(folder)
    settings = root / "config" / "experiments" / f"{FILM}.yaml"
    data, of_film = root / "data" / CABLE, root / "data" / FILM
    trial = data / "trial-01"
    trial.mkdir(parents=True)
    for camera, turn_rad in TURNS_RAD.items():
        text = SETTINGS.replace("frame_rate_hz: 100", f"frame_rate_hz: {RATES_HZ[camera]}")
        settings.write_text(text + "  rehearsal: false\n")
        monkeypatch.setattr(view, "OBLIQUE_RAD", (0.055, turn_rad, 0.008))
        run_stage("lab_calibrate", root, FILM)
        if camera == "left":
            run_stage("plan", root, FILM, 1)
        run_stage("lab_throw", root, FILM, 1)
        shutil.move(of_film / "calibration", data / "calibration" / camera)
        (of_film / "trial-01" / "video.mp4").rename(trial / f"{camera}.mp4")
    for name in ("joints.csv", "run.json", "motion.json"):
        shutil.copy(of_film / "trial-01" / name, trial)
    settings.unlink()
    string = "string: {length_m: 0.30, points: 10, weights: [{place_m: 0.30}]}\n"
    cameras = "cameras:\n  left:\n" + "".join(f"  {line}\n" for line in PLANE.splitlines()) + "  right: {}\n"
    (data / "experiment.yaml").write_text(string + FITTED + cameras)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("several") / "project"
    with pytest.MonkeyPatch.context() as monkeypatch:
        filmed(root, monkeypatch)
    line = [sys.executable, "-m", "strandcast", "run", CABLE, "--cores", "2"]
    watched = f"{WATCH}{os.pathsep}{environment()['PYTHONPATH']}"
    variables = environment(PYTHONPATH=watched, STRANDCAST_OPENED_FILES=str(root / OPENED))
    done = subprocess.run(line, cwd=root, env=variables, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]
    return root


@pytest.fixture
def copy(project: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(project, tmp_path / "copy"))


def test_a_throw_in_the_plane_is_found_there_by_two_cameras(project):
    results = project / "results" / CABLE / "trial-01"
    summary = TrackSummary.read(results / "track.json")
    assert summary.cameras == ["left", "right"]
    assert not [text for text in summary.warnings if "fit" in text]
    track = read_track(results / "track.parquet", 10)
    known = np.isfinite(track.points_m).all(axis=-1)
    assert known[:, 1:].mean() > 0.7
    off_m = track.points_m[..., 1][known]  # y is away from the cameras
    assert np.median(np.abs(off_m)) < 3e-3
    truth = read_parquet(project / "results" / FILM / "trial-01" / "lab_truth.parquet").to_pandas()
    tip = truth[truth.place_m == truth.place_m.max()].sort_values("robot_time_s")
    true_m = [np.interp(track.camera_time_s, tip.robot_time_s, tip[axis]) for axis in ("x_m", "y_m")]
    wrong_m = np.hypot(track.points_m[:, -1, 0] - true_m[0], track.points_m[:, -1, 2] - true_m[1])
    assert np.nanmedian(wrong_m) < 4e-3


def test_the_page_shows_what_each_camera_saw(project):
    page = (project / "results" / CABLE / "trial-01" / "report.html").read_text()
    for camera in TURNS_RAD:
        assert f"Strobe picture by camera {camera}" in page


def test_stages_open_what_they_declare(project):
    assert undeclared(project, CABLE) == set()
    for camera in TURNS_RAD:
        assert undeclared(project, f"{CABLE}/{camera}") == set()


def test_files_of_a_camera_belong_to_it(copy):
    track = copy / "results" / CABLE / "left" / "trial-01" / "track.json"
    place = place_of(track)
    assert place is not None
    assert (str(place), place.run) == ("cable/left trial 1", "strandcast run cable")
    assert verify(copy, CABLE) == []
    shutil.copy(copy / "results" / CABLE / "right" / "trial-01" / "track.json", track)
    [found] = [each for each in verify(copy, CABLE) if each.file == track]
    assert found.what == "was made for cable/right trial 1, but lies in the folder of cable/left trial 1"


def test_another_setting_of_one_camera_changes_nothing_of_the_other(copy):
    settings = copy / "data" / CABLE / "experiment.yaml"
    settings.write_text(settings.read_text().replace("right: {}", "right: {exposure_s: 0.0005}"))
    tasks = tasks_of(context_of(copy, CABLE), [1], {})
    again = [str(step) for step, task in tasks.items() if task.runs]
    assert {"track of trial 1, right", "join_views of trial 1", "estimate of trial 1"} <= {*again}
    assert not [step for step in again if "left" in step]


def test_the_first_camera_gives_the_frames(copy):
    settings = copy / "data" / CABLE / "experiment.yaml"
    first, last = settings.read_text().split("cameras:\n  left:\n")
    plane = last.replace("  right: {}\n", "")
    settings.write_text(f"{first}cameras:\n  right:\n{plane}  left: {{}}\n")
    again = [str(step) for step, task in tasks_of(context_of(copy, CABLE), [1], {}).items() if task.runs]
    assert "join_views of trial 1" in again
    assert not [step for step in again if "left" in step or "right" in step]


def test_results_of_a_camera_that_was_removed_stop_nothing(copy):
    settings = copy / "data" / CABLE / "experiment.yaml"
    text = settings.read_text()
    settings.write_text(text[: text.index("  right:")])
    (copy / "data" / CABLE / "calibration" / "right" / "plane.png").write_bytes(b"another")
    assert not [each for each in verify(copy, CABLE) if "right" in each.file.parts]


def test_warnings_of_every_cameras_records_are_in_the_summary(project):
    summary = TrackSummary.read(project / "results" / CABLE / "trial-01" / "track.json")
    said = "\n".join(summary.warnings)
    for camera in TURNS_RAD:
        assert f"{camera}: motion.json was planned for small trial 1" in said
        assert f"{camera}: camera.exposure_s is not given" in said
    assert "string_offset_m" not in said


def test_the_name_of_a_camera_is_asked_for_where_one_is_meant(project):
    for stage in ("calibrate", "ingest", "track"):
        with pytest.raises(
            StrandcastError, match="SC-F003.*several cameras\n.*one of cable/left, cable/right"
        ):
            files_of(stage, project, CABLE, 1)
    with pytest.raises(StrandcastError, match="SC-F003.*\n.*one of cable/left, cable/right"):
        files_of("track", project, "cable/middle", 1)
    with pytest.raises(StrandcastError, match="SC-R032.*\n.*without a camera's: cable"):
        files_of("estimate", project, "cable/left", 1)
    assert preview.run(project, "cable/left", 1)[0].startswith("cable/left trial 1: left.mp4")


def test_films_of_two_cameras_are_not_the_same(copy):
    film = copy / "data" / CABLE / "trial-01" / "right.mp4"
    of_left = Manifest.read(copy / "results" / CABLE / "left" / "trial-01" / "manifest.json")
    path = copy / "results" / CABLE / "right" / "trial-01" / "manifest.json"
    Manifest.read(path).model_copy(
        update={"video": of_left.video.model_copy(update={"file": film.name})}
    ).write(path)
    with pytest.raises(StrandcastError, match=r"SC-V023.*right\.mp4: is trial-01/left\.mp4, byte for byte"):
        run_stage("join_views", copy, CABLE, 1)


def test_a_setting_in_an_error_is_that_of_the_camera(copy):
    photo = copy / "data" / CABLE / "calibration" / "right" / "plane.png"
    photo.write_bytes((photo.parent / "lens-01.png").read_bytes())
    with pytest.raises(StrandcastError) as caught:
        run_stage("calibrate", copy, "cable/right")
    assert str(caught.value.field).startswith("cameras.right.plane")


def test_a_camera_is_an_experiment_in_python(project):
    assert strandcast.open(project)["cable/left"].trials[1].observations.size


def test_exports_of_the_plane_refuse_a_track_in_space(project):
    with pytest.raises(StrandcastError, match="SC-E008.*in space.*\n.*export csv cable 1"):
        read_throw(strandcast.open(project)[CABLE].trial(1))


def test_a_camera_is_named_below_data_too(project, monkeypatch):
    monkeypatch.chdir(project / "data")
    assert experiment_named("cable/left", Path("..")) == "cable/left"
    assert experiment_named("cable/trial-01", Path("..")) == "cable"


def test_results_without_their_film_are_not_shown_again(copy):
    for camera in TURNS_RAD:
        (copy / "data" / CABLE / "trial-01" / f"{camera}.mp4").unlink()
    assert "SC-W036" in str(refusal(copy, CABLE))


def test_a_missing_film_is_named(copy):
    assert check_experiment(copy, CABLE).errors == []
    (copy / "data" / CABLE / "trial-01" / "right.mp4").unlink()
    [error] = check_experiment(copy, CABLE).errors
    assert "no video right.*" in str(error)
    assert "left" not in str(error.fix)
    assert "right.*" in str(refusal(copy, CABLE))
