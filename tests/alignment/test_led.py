"""An LED's switchings in video and log: used, compared with the motion, or left out."""

import dataclasses
import re

import numpy as np
import pytest

from strandcast.config.align import AlignSettings, LedSettings, VideoSyncEvent
from strandcast.errors import StrandcastError
from strandcast.records.joint_log import SYNC_HIGH, SyncEvent
from strandcast.records.track import DetectedLed, DetectedSwitch

LIT_S = (0.05, 1.0)  # camera time
STILL = np.array([0.8, 0.5, 0.2])


@pytest.fixture(scope="module")
def trial(throw):
    return throw(5)


def detected(*switchings, sigma_s=2e-4):
    events = [
        DetectedSwitch(kind=kind, camera_time_s=camera_s, sigma_s=sigma_s) for kind, camera_s in switchings
    ]
    return DetectedLed(window_px=[0, 0, 9, 9], brightness_grey=[1.0], events=events)


def both(late_s=0.0):
    return ("led_on", LIT_S[0] + late_s), ("led_off", LIT_S[1] + late_s)


def switched(trial):
    """The events in run.json of an LED that is lit between LIT_S."""
    return [SyncEvent(kind=kind, time_s=trial.robot_s(camera_s)) for kind, camera_s in both()]


def with_led(trial, *switchings, sigma_s=2e-4, latency_s=0.0, latency_sd_s=1e-5, recorded=None):
    led = LedSettings(place_m=(0.0, 0.0), latency_s=(latency_s, latency_sd_s))
    return {
        "led": detected(*switchings, sigma_s=sigma_s),
        "settings": AlignSettings(led=led),
        "sync_events": switched(trial) if recorded is None else recorded,
    }


def test_an_led_that_agrees_is_used_and_reported(trial, fit, error_s):
    alone = fit(trial)
    found = fit(trial, **with_led(trial, *both(), sigma_s=1e-5))
    assert [(check.kind, check.used) for check in found.sync_events] == [("led_on", True), ("led_off", True)]
    assert found.warnings == alone.warnings
    assert found.middle_se_s < 0.6 * alone.middle_se_s
    assert found.drift_se < 0.6 * alone.drift_se
    assert abs(error_s(found, trial)) < 4 * found.middle_se_s


def test_a_known_delay_is_subtracted(trial, fit):
    found = fit(trial, **with_led(trial, *both(late_s=0.004), latency_s=0.004))
    assert all(check.used for check in found.sync_events)
    assert max(abs(check.difference_s) for check in found.sync_events) < 5e-4


def test_an_led_that_contradicts_is_reported_with_its_cost_and_left_out(trial, fit):
    alone = fit(trial)
    found = fit(trial, tip_speed_m_s=8.0, **with_led(trial, *both(late_s=0.005)))
    [warning] = [warning for warning in found.warnings if "SC-A023" in warning]
    by_ms, cost_mm = (float(re.search(f"([-+.0-9]+) {unit}", warning)[1]) for unit in ("ms", "mm"))
    assert by_ms == pytest.approx(-5.0, abs=0.5)
    assert cost_mm == pytest.approx(8.0 * abs(by_ms), abs=0.6)
    assert "a tip's 8.0 m/s" in warning
    assert [check.used for check in found.sync_events] == [False, False]
    assert found.sync_events[0].difference_s == pytest.approx(0.005, abs=5e-4)
    assert found.offset_s == alone.offset_s


def test_a_small_contradiction_is_left_out_silently(trial, fit):
    alone = fit(trial)
    found = fit(trial, **with_led(trial, *both(late_s=8e-4), sigma_s=1e-5))
    assert [check.used for check in found.sync_events] == [False, False]
    assert found.warnings == alone.warnings
    assert found.offset_s == alone.offset_s


def test_a_frame_of_uncertainty_is_no_contradiction(trial, fit):
    found = fit(trial, **with_led(trial, *both(late_s=0.003), sigma_s=0.0012))
    assert [check.used for check in found.sync_events] == [True, True]
    assert not any("SC-A023" in warning for warning in found.warnings)


@pytest.mark.parametrize("flash", [("led_on", 0.3), ("led_off", 0.7)])
def test_a_flash_of_something_else_has_no_counterpart(trial, fit, flash):
    found = fit(trial, **with_led(trial, both()[0], flash, both()[1]))
    assert [check.camera_time_s for check in found.sync_events] == list(LIT_S)
    [warning] = [warning for warning in found.warnings if "SC-A023" in warning]
    assert f"{flash[0]} at {flash[1]:.4f} s" in warning


def test_a_bouncing_relay_does_not_pair_one_switching_twice(trial, fit):
    on, off = switched(trial)
    again = on.model_copy(update={"time_s": on.time_s + 2e-4})
    found = fit(trial, **with_led(trial, *both(), recorded=[on, again, off]))
    assert [check.camera_time_s for check in found.sync_events] == list(LIT_S)


def test_another_light_alone_is_left_out(trial, fit):
    alone = fit(trial)
    found = fit(trial, **with_led(trial, ("led_on", 0.3), ("led_off", 0.5)))
    assert found.sync_events == []
    assert found.offset_s == alone.offset_s
    [warning] = [warning for warning in found.warnings if "SC-A023" in warning]
    assert "led_on at 0.3000 s" in warning


def test_of_several_single_ones_the_motion_chooses(trial, fit):
    found = fit(trial, **with_led(trial, ("led_on", 0.3), both()[1], ("led_off", 0.6)))
    assert [check.camera_time_s for check in found.sync_events] == [LIT_S[1]]


def test_a_log_without_events_is_reported_once(trial, fit):
    alone = fit(trial)
    found = fit(trial, **with_led(trial, *both(), recorded=[]))
    assert found.offset_s == alone.offset_s
    assert len(found.warnings) == len(alone.warnings) + 1
    assert "SC-A023" in found.warnings[-1]


def test_no_led_changes_nothing(trial, fit):
    assert fit(trial, **with_led(trial)) == fit(trial)


def test_the_logs_sync_output_is_used_for_the_led(trial, fit):
    on, off = (int(np.searchsorted(trial.log.time_s, trial.robot_s(at_s))) for at_s in LIT_S)
    flags = trial.log.flags.copy()
    flags[on:off] |= SYNC_HIGH
    log = dataclasses.replace(trial.log, flags=flags)
    found = fit(trial, log=log, **with_led(trial, *both(), recorded=[], sigma_s=1e-5))
    row_s = float(np.median(np.diff(log.time_s)))
    assert [check.kind for check in found.sync_events] == ["led_on", "led_off"]
    for check, at_s in zip(found.sync_events, LIT_S, strict=True):
        assert abs(check.robot_time_s - trial.robot_s(at_s)) < 0.5 * row_s + 1e-9
        assert check.sigma_s > row_s / np.sqrt(12.0)


def test_events_found_by_hand_override_the_led(trial, fit):
    by_hand = [VideoSyncEvent(trial=1, kind="led_on", camera_time_s=LIT_S[0], sigma_s=1e-3)]
    given = with_led(trial, *both(late_s=0.02))
    settings = given["settings"].model_copy(update={"sync_events": by_hand})
    found = fit(trial, **given | {"settings": settings})
    assert found == fit(trial, settings=AlignSettings(sync_events=by_hand), sync_events=switched(trial))
    assert len(found.sync_events) == 1


def test_without_motion_the_led_alone_gives_the_offset(throw, fit, motion):
    trial = throw(2, motion=motion(lambda t: np.tile(STILL, (len(t), 1))))
    found = fit(trial, **with_led(trial, *both(), latency_sd_s=3e-4))
    assert found.source == "event"
    assert abs(float(found.robot_time_s(np.array(0.5))) - trial.robot_s(0.5)) < 1e-4
    # Two switchings of one delay are no surer than one.
    assert found.middle_se_s == pytest.approx(np.hypot(2e-4, 3e-4), rel=0.05)
    with pytest.raises(StrandcastError, match="SC-A008"):
        fit(trial, **with_led(trial, both()[0], ("led_off", 0.4)))
