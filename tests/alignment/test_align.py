from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from strandcast.alignment.align import align, motion_span
from strandcast.alignment.fit import Priors
from strandcast.errors import StrandcastError
from strandcast.records.alignment import Alignment


def fit(recording, arm, **more) -> Alignment:
    return align(recording.markers, recording.log, arm, experiment="e", trial=1, **more)


def error_s(found: Alignment, recording) -> float:
    """At the middle of the sightings, where the offset is told apart from the drift."""
    middle = found.middle_camera_time_s
    return float(found.robot_time_s(np.array(middle)) - recording.robot_s(middle))


@pytest.mark.parametrize(("slow", "seeds"), [(0.0, range(8)), (0.9, range(20, 28))])
def test_the_offset_is_found_and_its_standard_error_is_honest(record, arm, slow, seeds):
    """Goal: 0.2 ms at 500 frames/s, with encoder noise, and zeros, markers and base displaced."""
    recordings = [record(seed, slow=slow) for seed in seeds]
    found = [fit(recording, arm) for recording in recordings]
    errors = np.array([error_s(*pair) for pair in zip(found, recordings, strict=True)])
    said = np.array([one.middle_se_s for one in found])
    assert said.max() < 1e-4
    assert np.abs(errors).max() < 2e-4
    assert np.sqrt(((errors / said) ** 2).mean()) < 1.7
    assert np.abs(errors / said).max() < 4.0
    at_zero = np.array(
        [one.offset_s - recording.offset_s for one, recording in zip(found, recordings, strict=True)]
    )
    assert np.abs(at_zero / [one.offset_se_s for one in found]).max() < 4.0
    assert max(one.offset_se_s for one in found) < 2e-4
    assert all(one.residual_rms_m < 7e-4 for one in found)


def test_the_standard_error_is_not_all_caution(record, arm):
    clean = fit(record(1, joint_noise_rad=0.0, joint_zero_rad=0.0, shift_m=0.0), arm)
    assert clean.middle_se_s < 2e-5


def test_slow_errors_make_a_larger_standard_error(record, arm):
    seeds = range(2)
    white = np.mean([fit(record(seed, joint_noise_rad=0.0), arm).middle_se_s for seed in seeds])
    slow = np.mean([fit(record(seed, joint_noise_rad=0.0, slow=0.95), arm).middle_se_s for seed in seeds])
    assert slow > 2.0 * white


def test_a_shifted_clock_shifts_the_offset_alone(record, arm):
    recording = record(3)
    before = fit(recording, arm)
    log = dataclasses.replace(recording.log, time_s=recording.log.time_s - 1000.0)
    after = align(recording.markers, log, arm, experiment="e", trial=1)
    assert before.offset_s - after.offset_s == pytest.approx(1000.0, abs=2e-6)


def test_large_drift_is_found_with_a_wide_prior_and_told(record, arm):
    recording = record(4)
    stretched = recording.markers | {"camera_time_s": recording.markers["camera_time_s"] / 1.01}
    found = align(stretched, recording.log, arm, experiment="e", trial=1, priors=Priors(drift=0.02))
    assert found.drift == pytest.approx(1.01 * (1 + recording.drift) - 1, abs=4 * found.drift_se + 1e-4)
    cautious = align(stretched, recording.log, arm, experiment="e", trial=1, priors=Priors(drift=2e-3))
    assert any("drift" in warning for warning in cautious.warnings)


def test_misread_markers_and_gaps_do_no_harm(record, arm):
    recording = record(5)
    markers = {name: column.copy() for name, column in recording.markers.items()}
    draw = np.random.default_rng(0)
    bad = draw.choice(len(markers["x_m"]), 40, replace=False)
    markers["x_m"][bad] += draw.uniform(-0.3, 0.3, 40)
    markers["angle_rad"][bad] += 1.5
    keep = draw.uniform(size=len(markers["x_m"])) < 0.7
    found = align({n: c[keep] for n, c in markers.items()}, recording.log, arm, experiment="e", trial=1)
    assert abs(error_s(found, recording)) < 1e-4


def test_the_log_of_another_trial_is_refused(record, arm):
    recording = record(6, log_of=7)
    with pytest.raises(StrandcastError, match="log of another trial") as refusal:
        fit(recording, arm, log_file="trial-02/joints.csv")
    assert refusal.value.code == "SC-A007"
    assert refusal.value.file == "trial-02/joints.csv"


def test_degrees_and_swapped_joints_are_refused(record, arm):
    recording = record(6)
    degrees = dataclasses.replace(recording.log, q_rad=np.degrees(recording.log.q_rad))
    swapped = dataclasses.replace(recording.log, q_rad=recording.log.q_rad[:, ::-1])
    for log in (degrees, swapped):
        with pytest.raises(StrandcastError, match="SC-A007"):
            align(recording.markers, log, arm, experiment="e", trial=1)


def test_no_motion_is_refused_with_what_to_do(record, arm):
    with pytest.raises(StrandcastError, match="sync wiggle"):
        fit(record(1, reach=0.0, joint_noise_rad=0.0), arm)
    with pytest.raises(StrandcastError, match=r"the hand moves .* mm in the video"):
        fit(record(1, reach=0.01), arm)
    empty = {name: column[:5] for name, column in record(1).markers.items()}
    with pytest.raises(StrandcastError, match="shows the hand's markers 5 times"):
        align(empty, record(1).log, arm, experiment="e", trial=1)


def test_a_motion_that_repeats_itself_is_refused(record, arm):
    recording = record(2)
    log = recording.log
    rows = len(log.time_s)
    twice = dataclasses.replace(
        log,
        time_s=log.time_s[0] + np.arange(2 * rows) * 0.002,
        q_rad=np.tile(log.q_rad, (2, 1)),
        q_cmd_rad=np.tile(log.q_cmd_rad, (2, 1)),
    )
    with pytest.raises(StrandcastError, match="two offsets"):
        align(recording.markers, twice, arm, experiment="e", trial=1)
    near = align(recording.markers, twice, arm, experiment="e", trial=1, largest_offset_s=1.0)
    assert abs(error_s(near, recording)) < 1e-4


def test_a_log_with_other_joints_is_refused(record, arm):
    recording = record(1)
    log = dataclasses.replace(recording.log, joint_names=["a", "b", "c"])
    with pytest.raises(StrandcastError, match="has no joint_1, joint_2, joint_3; it has a, b, c"):
        align(recording.markers, log, arm, experiment="e", trial=1)


def test_lost_and_doubled_rows_of_the_log_do_no_harm(record, arm):
    recording = record(8)
    draw = np.random.default_rng(1)
    rows = np.sort(np.concatenate([np.flatnonzero(draw.uniform(size=900) < 0.9), [100, 300, 500]]))
    rows = rows[rows < len(recording.log.time_s)]
    log = dataclasses.replace(
        recording.log,
        time_s=recording.log.time_s[rows],
        q_rad=recording.log.q_rad[rows],
        q_cmd_rad=recording.log.q_cmd_rad[rows],
    )
    found = align(recording.markers, log, arm, experiment="e", trial=1)
    assert abs(error_s(found, recording)) < 1e-4


def test_the_motion_is_found_in_the_joints(record):
    log = record(9).log
    start_s, end_s = motion_span(log.time_s, log.q_rad)
    assert start_s == pytest.approx(1305.0 + 0.03, abs=0.04)  # a minimum-jerk start is slow
    assert end_s == pytest.approx(1305.6 - 0.03, abs=0.04)


def test_a_sync_event_is_held_against_the_fit(record, arm):
    recording = record(1)
    agreed = fit(recording, arm, sync_s=(0.2, recording.robot_s(0.2)))
    assert abs(agreed.sync_event["difference_s"]) < 2e-4
    assert not any("sync" in warning for warning in agreed.warnings)
    late = fit(recording, arm, sync_s=(0.2, recording.robot_s(0.2) - 0.02))
    assert late.sync_event["difference_s"] == pytest.approx(0.02, abs=2e-4)
    assert any("+20.0 ms" in warning for warning in late.warnings)
