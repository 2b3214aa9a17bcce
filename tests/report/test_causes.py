"""Every fault that a trial's results can prove is named with its size; a good throw is accused of nothing."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from strandcast.records.estimate import RigOffsets
from strandcast.records.manifest import Manifest
from strandcast.records.record import RigFault
from strandcast.report.causes import caveat, probable_causes, slip_in_clamp
from strandcast.report.checks import WARN, run_checks
from strandcast.report.facts import Facts
from strandcast.report.panels.next_motion import next_motion
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.panels.parameters import parameters
from strandcast.report.panels.registry import panels_of
from strandcast.report.panels.tracking import slip_panel
from strandcast.report.results import TrialResults, read_results
from strandcast.report.text import methods, uncertain_verdict, verdict_badge
from strandcast.report.trial_page import trial_page


@pytest.fixture
def good(results) -> TrialResults:
    """Return a trial's results; its motion is said to begin 0.1 s later, after some frames at rest."""
    found = read_results(results / "trial-01")
    return with_record(found, "alignment", motion_start_s=found.pieces["alignment"].motion_start_s + 0.1)


def with_record(results: TrialResults, name: str, **fields) -> TrialResults:
    """Return the results with other fields in one record."""
    record = results.pieces[name].model_copy(update=fields)
    return dataclasses.replace(results, pieces=results.pieces | {name: record})


def with_points(results: TrialResults, change) -> TrialResults:
    """Return the results with the track's points (F, n + 1, 2) changed in place, given their robot times."""
    points_m = results.pieces["track"].points_m.copy()
    change(points_m, results.robot_time_s())
    track = dataclasses.replace(results.pieces["track"], points_m=points_m)
    return dataclasses.replace(results, pieces=results.pieces | {"track": track})


def slipped_by(results: TrialResults, length_m: float) -> TrialResults:
    """Return the results of a string that slips 0.15 s after the motion's start."""
    start_s = results.pieces["alignment"].motion_start_s

    def change(points_m: np.ndarray, time_s: np.ndarray) -> None:
        hand = points_m[:, :1]
        along = points_m[:, 1:] - hand
        reach = np.linalg.norm(along[:, -1:], axis=2, keepdims=True)
        late = (time_s > start_s + 0.15)[:, None, None]
        points_m[:, 1:] += np.where(late, along / reach * length_m, 0.0)

    return with_points(results, change)


@pytest.mark.usefixtures("undrawn")
def test_good_throws_are_accused_of_nothing(results):
    for trial in ("trial-01", "trial-02", "trial-03"):
        assert probable_causes(read_results(results / trial)) == []
        page = trial_page(results / trial, trial=1, experiment="swing")
        assert "Most probable fault" not in page
        assert "✕" not in page.partition("</header>")[0]


def test_a_slip_in_the_clamp_is_named_with_its_length_and_time(good):
    before = slip_in_clamp(good)
    bad = slipped_by(good, 0.02)
    found = slip_in_clamp(bad)
    assert found.rise_m - before.rise_m == pytest.approx(0.02, abs=0.002)
    assert found.since_start_s == pytest.approx(0.15, abs=0.02)
    (cause,) = probable_causes(bad)
    assert "slipped out of the clamp by about 2" in cause.what
    checks = {check.name: check for check in run_checks(bad, None)}
    assert checks["track: string held by the clamp"].state == WARN
    length = checks["track: length of the string"]
    assert (length.state, "at rest →" in length.found) == (WARN, True)
    content = slip_panel(TrialPageData(bad))
    assert content.drawing is not None
    assert "at rest →" in content.finding
    (panel,) = (each for each in panels_of("trial") if each.name == "slip")
    assert panel.shown(TrialPageData(bad))
    assert not panel.shown(TrialPageData(good))


def test_a_small_slip_is_within_what_grasps_differ_by(good):
    assert probable_causes(slipped_by(good, 0.002)) == []


def fault(what: str, field: str) -> RigFault:
    return RigFault(what=what, cost="millimetres", fix="measure it", field=field)


TOO_LONG = fault("string.length_m: 280.0 ± 0.5 mm hang from the clamp, not 300.0 mm", "string.length_m")


def test_every_fault_that_a_stage_names_is_among_the_causes(good):
    weight = fault(
        "string.weights: the weight declared 250 mm from the clamp is seen 235 mm", "string.weights"
    )
    zero, link = (
        fault(f"{number} is wrong", "the arm's file") for number in ("the zero of joint 2", "link 1")
    )
    assert [cause.what for cause in probable_causes(with_record(good, "alignment", faults=[zero]))] == [
        zero.what
    ]
    offsets = RigOffsets(
        trials=[1, 2],
        right_probability=0.0,
        together_m=0.004,
        zero_scatter_rad=1e-3,
        numbers=[],
        faults=[link],
    )
    choices = {"length_m": 0.28, "length_sigma_m": 0.0005}
    bad = with_record(good, "track_summary", faults=[TOO_LONG], choices=choices)
    bad = with_record(bad, "estimate", faults=[weight], rig_offsets=offsets)
    # Trials together tell which number of the arm's file it is.
    bad = with_record(bad, "alignment", faults=[zero])
    causes = probable_causes(bad)
    assert [cause.what for cause in causes] == [TOO_LONG.what, weight.what, link.what]
    assert "trials 1, 2 together" in causes[-1].evidence
    # Where they find nothing, one throw accuses the camera alone.
    scale = fault("the camera's scale is off by 1 %", "camera.plane")
    right = with_record(good, "estimate", rig_offsets=offsets.model_copy(update={"faults": []}))
    right = with_record(right, "alignment", faults=[zero, scale])
    assert [cause.what for cause in probable_causes(right)] == [scale.what]
    checks = {check.name: check.state for check in run_checks(bad, None)}
    assert checks["track: length of the string"] == WARN
    assert checks["alignment: arm and its files"] == WARN


def test_a_rope_that_leaves_the_clamp_sideways_has_not_slipped(good):
    """At rest it bends away from the clamp, and its end is nearer to it than the rope is long."""
    start_s = good.pieces["alignment"].motion_start_s

    def change(points_m: np.ndarray, time_s: np.ndarray) -> None:
        along_m = np.linspace(0.0, 0.48, points_m.shape[1])[1:]
        radius_m = 0.025  # the end is 14 mm nearer to the clamp than the rope is long
        turned = np.minimum(along_m / radius_m, np.pi / 2)
        down_m = radius_m * (1.0 - np.cos(turned)) + np.maximum(along_m - radius_m * np.pi / 2, 0.0)
        bent = np.column_stack([radius_m * np.sin(turned), -down_m])
        straight = np.column_stack([np.zeros_like(along_m), -along_m])
        resting = (time_s < start_s)[:, None, None]
        points_m[:, 1:] = points_m[:, :1] + np.where(resting, bent, straight)

    assert probable_causes(with_points(good, change)) == []


def test_a_lost_tip_is_named_with_the_frames_of_the_gap(good):
    target_m = np.array(good.pieces["verdict"].target_m)
    apart_m = np.linalg.norm(good.pieces["track"].points_m[:, -1] - target_m, axis=1)
    closest = int(np.nanargmin(apart_m))

    def lose(points_m: np.ndarray, _: np.ndarray) -> None:
        points_m[closest - 6 : closest + 7, -1] = np.nan

    bad = with_record(good, "verdict", miss_m=None, hit=None, reason="the tip was not tracked")
    choices = bad.pieces["track_summary"].choices | {"target_seen": False}
    (cause,) = probable_causes(with_record(with_points(bad, lose), "track_summary", choices=choices))
    assert "not found in 13 of the frames between, and doubtful in the other 0" in cause.evidence
    assert "The target itself was not found" in cause.evidence
    assert "lost the string’s tip" in cause.what
    assert f"frames {closest - 7} to {closest + 7}" in cause.fix


def test_a_film_that_ends_before_the_motion_is_named(good):
    end_s = float(good.robot_time_s()[-1])
    bad = with_record(good, "verdict", miss_m=None, hit=None, reason="the track ends")
    (cause,) = probable_causes(with_record(bad, "alignment", motion_end_s=end_s + 0.25))
    assert cause.what.replace("\u00a0", " ") == "the film ends 250 ms before the motion does"
    assert "frames" not in cause.fix


def test_a_wrong_frame_rate_is_named_with_the_right_one(good):
    rate_hz = good.pieces["manifest"].video.frame_rate_hz
    bad = with_record(good, "alignment", drift=0.01, drift_se=1e-4)
    (cause,) = probable_causes(bad)
    assert "frame rate is wrong" in cause.what
    assert f"camera.frame_rate_hz: {rate_hz / 1.01:.6g}" in cause.fix
    assert "running 1.00 ± 0.01 % slower" in cause.evidence.replace("\u00a0", " ")
    (cause,) = probable_causes(with_record(good, "alignment", drift=rate_hz / 119880.0 - 1.0, drift_se=1e-6))
    assert cause.first == "set camera.frame_rate_hz: 119880 and run again"
    assert " % faster" in cause.evidence.replace("\u00a0", " ")
    assert probable_causes(with_record(good, "alignment", drift=0.002, drift_se=1e-3)) == []


@pytest.fixture
def too_short(good) -> TrialResults:
    """Return the results of a string that is 20 mm shorter than declared."""
    return with_record(good, "track_summary", faults=[TOO_LONG])


def test_nothing_after_a_named_fault_reads_as_safe(results, too_short):
    words = caveat(too_short)
    assert words == "after the named fault: not to be trusted; first correct string.length_m and run again"
    bound = [fit.model_copy(update={"at_bound": True}) for fit in too_short.pieces["estimate"].parameters]
    bad = with_record(too_short, "estimate", parameters=bound)
    path = results / "trial-02" / "motion.json"
    check = run_checks(bad, path)[-1]
    assert (check.state, words in check.found) == (WARN, True)
    page = TrialPageData(bad, next_motion=path, facts=Facts(play_command="strandcast play"))
    content = next_motion(page)
    assert content.finding.lower().startswith(words)
    assert content.tables[0].rows[-1] == ["command to play it", words]
    table = parameters(page).tables[0]
    column = table.heads.index("bound")
    assert all(words in str(row[column]) for row in table.rows[: len(bound)])
    assert "widen" not in str(table.rows)


def test_the_methods_name_the_fault_with_its_numbers(good, too_short):
    assert "Do not use" not in methods(good)
    assert f"Known and not corrected: {TOO_LONG.what}" in methods(too_short)
    rate_hz = good.pieces["manifest"].video.frame_rate_hz
    corrected = methods(with_record(good, "alignment", drift=0.01, drift_se=1e-4)).replace("\u00a0", " ")
    assert f"corrected to {rate_hz / 1.01:.3f} ±" in corrected


def test_the_methods_mention_a_rehearsal(good):
    motion = good.pieces["motion"]
    assert "empty clamp" not in methods(good)
    assert f"The motion was planned by “{motion.provenance.planner}”." in methods(good)
    kind = motion.provenance.model_copy(update={"kind": "rehearsed"})
    assert "played with an empty clamp" in methods(with_record(good, "motion", provenance=kind))


@pytest.mark.parametrize(("beyond_m", "word"), [(-0.001, "HIT?"), (0.001, "MISS?"), (-0.005, "HIT")])
def test_a_miss_near_the_hit_radius_gets_a_question_mark(good, beyond_m, word):
    radius_m = good.pieces["verdict"].hit_radius_m
    fields = {"miss_m": radius_m + beyond_m, "miss_sigma_m": 0.002, "hit": beyond_m < 0}
    near = with_record(good, "verdict", **fields)
    assert verdict_badge(near.get("verdict"), None, uncertain=uncertain_verdict(near)).word == word


@pytest.mark.usefixtures("undrawn")
def test_a_plan_is_not_taken_for_what_was_played(results, tmp_path):
    """The log names no motion: the plan that lies in the folder may be another one."""
    folder = Path(shutil.copytree(results, tmp_path / "swing")) / "trial-03"
    manifest = Manifest.read(folder / "manifest.json")
    assert read_results(folder).get("motion") is not None
    manifest.model_copy(update={"motion_sha256": None}).write(folder / "manifest.json")
    found = read_results(folder)
    assert (found.get("motion"), found.get("predicted"), found.unread()) == (None, None, {})
    words = trial_page(folder, trial=3, experiment="swing")
    assert "nothing was predicted" in words
    assert "predicted range" not in words


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("name", ["predicted.parquet", "motion.json"])
def test_a_missing_optional_file_leaves_a_figure_out_without_alarm(results, tmp_path, name):
    folder = Path(shutil.copytree(results, tmp_path / "swing")) / "trial-03"
    (folder / name).unlink(missing_ok=True)
    assert read_results(folder).unread() == {}
    page = trial_page(folder, trial=3, experiment="swing")
    section = page[page.index('id="predicted"') :]
    section = section[: section.index("</section>")]
    assert "This figure is left out" in section
    assert "alert" not in section
    assert "strandcast run" not in section
