"""What tracking saw of the LED reaches the alignment."""

import shutil

import pytest

from strandcast.arm.load import load_arm
from strandcast.records.alignment import Alignment
from strandcast.records.joint_log import Run, SyncEvent, timing_of, write_joint_log
from strandcast.records.tables import write_table
from strandcast.records.track import MARKERS, DetectedLed, DetectedSwitch, TrackSummary
from strandcast.stages.run import run_stage
from strandcast_studies.evidence.clock_trials import ARM_FILE, clock_trial

SETTINGS = "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\nseed: 1\n"
LIT_S = (0.05, 1.0)


@pytest.fixture
def root(tmp_path, project_root):
    shutil.copytree(project_root / "config" / "arms", tmp_path / "config" / "arms")
    trial = clock_trial(load_arm(ARM_FILE).planar(), 5)
    data, results = (tmp_path / name / "e" / "trial-01" for name in ("data", "results"))
    data.mkdir(parents=True)
    results.mkdir(parents=True)
    sha256 = write_joint_log(data / "joints.csv", trial.log)
    kinds = ("led_on", "led_off")
    Run(
        complete=True,
        status="ok",
        reason=None,
        joints_sha256=sha256,
        rows=len(trial.log.time_s),
        motion_sha256=None,
        arm_sha256=None,
        driver="test",
        controller={},
        joint_names=trial.log.joint_names,
        clock="test",
        motion_start_s=None,
        motion_end_s=None,
        video={},
        timing=timing_of(trial.log.time_s, 500.0),
        sync_events=[SyncEvent(kind=k, time_s=trial.robot_s(s)) for k, s in zip(kinds, LIT_S, strict=True)],
    ).write(data / "run.json")
    write_table(results / "markers.parquet", MARKERS, trial.markers)
    (results / "manifest.json").write_text("{}")  # must be there, but is not read
    events = [
        DetectedSwitch(kind=k, camera_time_s=s + 0.003, sigma_s=5e-4)
        for k, s in zip(kinds, LIT_S, strict=True)
    ]
    TrackSummary(
        experiment="e",
        trial=1,
        source="video",
        points=10,
        length_m=0.3,
        decoded_frames=1,
        expected_frames=1,
        tracked_fraction=1.0,
        tip_fraction=1.0,
        marker_fraction=1.0,
        median_sigma_m=0.001,
        choices={},
        warnings=[],
        led=DetectedLed(window_px=[0, 0, 9, 9], brightness_grey=[1.0], events=events),
    ).write(results / "track.json")
    return tmp_path


def aligned(root, more):
    (root / "data/e/experiment.yaml").write_text(SETTINGS + more)
    run_stage("align", root, "e", 1)
    return Alignment.read(root / "results/e/trial-01/alignment.json")


def test_the_led_is_used_with_its_delay_unless_it_is_not_wanted(root):
    assert aligned(root, "").sync_events == []
    delayed = aligned(root, "align: {led: {place_m: [0.1, 0.2], latency_s: [0.003, 2.0e-4]}}")
    assert [(check.kind, check.used) for check in delayed.sync_events] == [
        ("led_on", True),
        ("led_off", True),
    ]
    assert max(abs(check.difference_s) for check in delayed.sync_events) < 5e-4
    # As it enters the fit: two switchings of one delay.
    assert delayed.sync_events[0].sigma_s == pytest.approx(2**0.5 * (5e-4**2 + 2e-4**2) ** 0.5, rel=0.01)
    denied = aligned(root, "align: {led: {place_m: [0.1, 0.2], latency_s: [0.0, 1.0e-5]}}")
    assert any("SC-A023" in warning for warning in denied.warnings)
