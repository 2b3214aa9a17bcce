import dataclasses

import numpy as np
import pytest

from strandcast.alignment.log_rows import LogRows, log_rows_of, motion_span
from strandcast.config.align import AlignSettings
from strandcast.errors import StrandcastError
from strandcast_studies.evidence.clock_trials import Faults, Recipe
from strandcast_studies.evidence.clocks import HALF_BLIND, WORN, coverage

START = np.array([0.5, 0.2, 0.1])


@pytest.mark.parametrize(
    ("recipe", "trials"),
    [
        pytest.param(Recipe(), 20, marks=pytest.mark.thorough),
        pytest.param(Recipe(faults=WORN), 10, marks=pytest.mark.thorough),
        pytest.param(Recipe(faults=HALF_BLIND), 10, marks=pytest.mark.thorough),
    ],
)
def test_the_standard_error_is_honest(arm, recipe, trials):
    """The small version of `python -m strandcast_studies.evidence.clocks`; other seeds than its own."""
    found = coverage(arm, "", recipe, range(trials))
    assert found.refused == {}
    assert 0.6 < found.z_rms < 1.5
    assert found.z_largest < 4.0
    assert found.within > 0.8
    assert found.se_median_ms < 0.15
    assert found.error_rms_ms < 0.15


def test_a_good_rig_makes_a_small_standard_error(throw, fit, error_s):
    """Encoders, markers and camera nearly perfect: the error is not all caution."""
    sharp = Faults(
        base_m=0,
        zero_rad=0,
        log_rad=1e-5,
        glued_m=0,
        glued_rad=0,
        camera_m=0,
        camera_rad=0,
        focal=0,
        white_px=(0.01, 0.01),
        slow_px=(0, 0),
        pixel_px=0,
        blur_rad=0,
        lost=0,
        misread=0,
    )
    trial = throw(5, faults=sharp)
    found = fit(trial)
    assert found.middle_se_s < 1.5e-5
    assert abs(error_s(found, trial)) < 5e-5
    assert found.residual_rms_m < 1e-4
    assert found.warnings == []


@pytest.mark.thorough
def test_correlated_errors_increase_the_standard_error(throw, fit):
    def mean_se(**errors) -> float:
        kind = Faults(white_px=(0.1, 0.1), pixel_px=0.0, **errors)
        return float(np.mean([fit(throw(seed, faults=kind)).middle_se_s for seed in range(3)]))

    assert mean_se(slow_px=(0.1, 0.1), slow_s=(0.03, 0.03)) > 1.5 * mean_se(slow_px=(0.0, 0.0))


def test_a_shifted_clock_shifts_the_offset_alone(throw, fit):
    trial = throw(3)
    later = dataclasses.replace(trial.log, time_s=trial.log.time_s + 1000.0)
    before, after = fit(trial), fit(trial, log=later)
    assert after.offset_s - before.offset_s == pytest.approx(1000.0, abs=5e-6)
    assert after.middle_se_s == pytest.approx(before.middle_se_s, rel=0.05)


def test_the_record_holds_what_was_fitted(throw, fit, tmp_path):
    trial = throw(2, faults=Faults(glued_m=2e-3))
    found = fit(trial)
    found.write(tmp_path / "alignment.json")
    again = type(found).read(tmp_path / "alignment.json")
    assert again == found
    assert [one.marker for one in again.markers] == [40, 41]
    assert sum(one.sightings for one in again.markers) <= len(trial.markers["frame"])
    assert again.frames == len(np.unique(trial.markers["camera_time_s"]))
    assert len(again.joint_zero_rad) == len(again.link_length_m) == 3


def test_a_drift_of_two_percent_is_corrected_and_reported(throw, fit):
    trial = throw(4)
    stretched = trial.markers | {"camera_time_s": trial.markers["camera_time_s"] / 1.02}
    found = fit(trial, markers=stretched)
    assert found.drift == pytest.approx(1.02 * (1 + trial.drift) - 1, abs=4 * found.drift_se)
    assert any(
        "the clocks drift by" in warning and "frame_rate_hz: 500" in warning for warning in found.warnings
    )


@pytest.mark.parametrize("ratio", [0.99, 0.998])
def test_a_wrong_rate_is_not_absorbed_by_the_rigs_constants(throw, fit, ratio):
    trial = throw(5)
    wrong = trial.markers | {"camera_time_s": trial.markers["camera_time_s"] * ratio}
    found = fit(trial, markers=wrong)
    assert found.drift == pytest.approx(1.0 / ratio - 1.0, abs=5e-4)


@pytest.mark.thorough
def test_one_joint_with_a_wrong_zero_is_named_and_no_other(throw, fit):
    trial = throw(5)
    q_rad = trial.log.q_rad.copy()
    q_rad[:, 1] -= 0.03
    found = fit(trial, log=dataclasses.replace(trial.log, q_rad=q_rad))
    assert found.joint_zero_rad == pytest.approx([0.0, 0.03, 0.0], abs=0.004)
    assert any("the zero of joint_2 is off by +" in text for text in found.warnings)


def test_drift_beyond_100_ppm_is_flagged(throw, fit):
    trial = throw(4)
    stretched = trial.markers | {"camera_time_s": trial.markers["camera_time_s"] / 1.0003}
    found = fit(trial, markers=stretched, settings=AlignSettings(drift=(0.0, 2e-3)))
    assert found.drift == pytest.approx(3e-4 + trial.drift, abs=3 * found.drift_se)
    assert any("ppm" in warning for warning in found.warnings)
    assert not any("ppm" in warning for warning in fit(trial).warnings)


def test_one_noisy_marker_does_not_spoil_the_other(throw, fit, error_s):
    trial = throw(5)
    markers = {name: column.copy() for name, column in trial.markers.items()}
    loose = markers["marker"] == 41
    draw = np.random.default_rng(1)
    for name, size in (("x_m", 4e-3), ("y_m", 4e-3), ("angle_rad", 0.05)):
        markers[name][loose] += draw.normal(0, size, loose.sum())
    found = fit(trial, markers=markers)
    assert abs(error_s(found, trial)) < 4 * found.middle_se_s
    assert found.middle_se_s < 3 * fit(trial).middle_se_s
    assert any("marker 41 is" in warning and "times as noisy" in warning for warning in found.warnings)


def test_a_marker_that_is_seen_only_briefly_does_not_spoil_the_other(throw, fit, error_s):
    trial = throw(5)
    frame = trial.markers["frame"]
    kept = (trial.markers["marker"] == 40) | ((frame >= 440) & (frame < 470))
    found = fit(trial, markers={name: column[kept] for name, column in trial.markers.items()})
    assert abs(error_s(found, trial)) < 4 * found.middle_se_s


def test_a_throw_that_fills_one_percent_of_a_film_is_seen(throw, fit):
    trial, rest, frames = throw(5), {}, 22500
    first = [0, np.argmax(trial.markers["marker"] == 41)]
    for name, column in trial.markers.items():
        rest[name] = np.concatenate([np.tile(column[first], frames), column])
    rest["camera_time_s"][: 2 * frames] = np.repeat(np.arange(frames) / 500.0, 2)
    rest["camera_time_s"][2 * frames :] += 45.0
    found = fit(trial, markers=rest, settings=AlignSettings(largest_offset_s=60.0))
    robot_s = float(found.robot_time_s(np.array(found.middle_camera_time_s)))
    off_s = robot_s - trial.robot_s(found.middle_camera_time_s - 45.0)
    assert abs(off_s) < 4 * found.middle_se_s


def test_a_misread_marker_is_left_out_and_reported(throw, fit, error_s):
    trial = throw(5, faults=Faults(misread=0.0))
    markers = {name: column.copy() for name, column in trial.markers.items()}
    draw = np.random.default_rng(1)
    bad = draw.choice(np.flatnonzero(markers["marker"] == 40), 60, replace=False)
    markers["x_m"][bad] += draw.uniform(-0.3, 0.3, 60)
    found = fit(trial, markers=markers)
    assert found.markers[0].wrong >= 55
    assert found.markers[1].wrong <= 5
    assert abs(error_s(found, trial)) < 4 * found.middle_se_s
    assert any("of marker 40's detections are wrong" in warning for warning in found.warnings)


def test_a_marker_in_the_wrong_place_is_named(throw, fit, arm, error_s):
    trial = throw(5)
    moved = dataclasses.replace(arm.markers[1], place_m=(-0.115, 0.015))
    found = fit(trial, on=dataclasses.replace(arm, markers=(arm.markers[0], moved)))
    assert abs(error_s(found, trial)) < 4 * found.middle_se_s
    assert found.markers[1].shift_m[1] == pytest.approx(-0.015, abs=0.005)
    assert any("marker 41 sits" in warning for warning in found.warnings)


def test_unsorted_and_doubled_rows_have_no_effect(throw, fit, error_s, rows):
    trial = throw(5)
    order = np.arange(len(trial.log.time_s))
    for k in (200, 310, 420):
        order[[k, k + 1]] = order[[k + 1, k]]
    order = np.insert(order, [350, 400], [order[350], order[400]])
    found = fit(trial, log=rows(trial.log, order))
    assert found.offset_s == pytest.approx(fit(trial).offset_s, abs=1e-9)
    assert "3 rows of the log were out of order and were sorted" in found.warnings
    assert "2 rows of the log have the time of another and were left out" in found.warnings
    with pytest.raises(StrandcastError, match="run backwards") as refusal:
        fit(trial, log=rows(trial.log, np.random.default_rng(0).permutation(len(order) - 2)))
    assert refusal.value.code == "SC-J001"


def test_rows_that_are_wrong_or_repeated_are_left_out(throw, fit, error_s):
    trial = throw(5)
    q = trial.log.q_rad.copy()
    start_s = motion_span(LogRows(trial.log.time_s, q))[0]
    start = int(np.searchsorted(trial.log.time_s, start_s))
    q[start + 60] += 0.2
    q[start + 91] = q[start + 90]
    found = fit(trial, log=dataclasses.replace(trial.log, q_rad=q))
    assert found.wrong_rows == 2
    assert found.offset_s == pytest.approx(fit(trial).offset_s, abs=2e-5)


def test_the_motion_is_found_in_the_joints(arm, motion, throw):
    ramp = motion(lambda t: np.outer(np.clip(t - 0.1, 0, 0.3), [1.0, 2.0, -1.0]) + START)
    trial = throw(0, motion=ramp, faults=Faults(log_rad=2e-4))
    start_s, end_s = motion_span(log_rows_of(trial.log, arm))
    begin_s = trial.log.time_s[0] + 0.5
    assert start_s == pytest.approx(begin_s + 0.1 + 0.02, abs=0.03)  # the servo trails
    assert end_s == pytest.approx(begin_s + 0.4 + 0.10, abs=0.06)
