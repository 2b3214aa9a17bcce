import dataclasses

import numpy as np
import pytest

from strandcast.alignment.events import SYNC_OUTPUT
from strandcast.alignment.search import ANY_DRIFT
from strandcast.config.align import AlignSettings, VideoSyncEvent
from strandcast.errors import StrandcastError
from strandcast.records.joint_log import SYNC_HIGH, SyncEvent

STILL = np.array([0.8, 0.5, 0.2])


@pytest.fixture(scope="module")
def trial(throw):
    return throw(5)


def led(trial, camera_s, late_s=0.0, sigma_s=1e-3, kind="led"):
    """An LED that lights at a camera time; the log records it `late_s` too late."""
    recorded = SyncEvent(kind=kind, time_s=trial.robot_s(camera_s) + late_s)
    return {"settings": in_video("led", camera_s, sigma_s), "sync_events": [recorded]}


def in_video(kind, camera_s, sigma_s):
    event = VideoSyncEvent(trial=1, kind=kind, camera_time_s=camera_s, sigma_s=sigma_s)
    return AlignSettings(sync_events=[event])


def test_an_event_that_agrees_is_reported_and_sharpens_the_offset(trial, fit, error_s):
    alone = fit(trial)
    coarse = fit(trial, **led(trial, 0.1, sigma_s=1e-3))
    [check] = coarse.sync_events
    assert abs(check.difference_s) < 4 * check.motion_se_s
    assert coarse.middle_se_s == pytest.approx(alone.middle_se_s, rel=0.05)
    sharp = fit(trial, **led(trial, 0.1, sigma_s=1e-5))
    assert sharp.middle_se_s < 0.6 * alone.middle_se_s
    assert abs(error_s(sharp, trial)) < 4 * sharp.middle_se_s


def test_two_events_far_apart_determine_the_drift(throw, fit):
    trial = throw(5, drift=3e-4)
    pairs = [led(trial, camera_s, sigma_s=1e-5) for camera_s in (0.05, 1.0)]
    in_both = [event for pair in pairs for event in pair["settings"].sync_events]
    recorded = [event for pair in pairs for event in pair["sync_events"]]
    found = fit(trial, settings=AlignSettings(sync_events=in_both), sync_events=recorded)
    assert found.drift == pytest.approx(trial.drift, abs=4 * found.drift_se)
    assert found.drift_se < 2e-5


def test_a_drift_that_contradicts_its_prior_stays_free_with_an_event(trial, fit):
    wrong = trial.markers | {"camera_time_s": trial.markers["camera_time_s"] * 0.99}
    event = led(trial, 0.1) | {"settings": in_video("led", 0.099, 1e-3)}
    for found in (fit(trial, markers=wrong), fit(trial, markers=wrong, **event)):
        assert found.drift == pytest.approx(0.0101, abs=5e-4)
        assert found.drift_prior == ANY_DRIFT


def test_an_event_that_contradicts_is_refused_with_both_numbers(trial, fit):
    with pytest.raises(StrandcastError) as refusal:
        fit(trial, **led(trial, 0.1, late_s=0.02))
    assert refusal.value.code == "SC-A018"
    by_motion_ms = fit(trial).offset_s * 1e3
    numbers = [float(word) for word in refusal.value.what.replace("(", " ").split() if is_number(word)]
    assert any(abs(number - by_motion_ms) < 0.5 for number in numbers)
    assert any(abs(number - by_motion_ms - 20.0) < 0.5 for number in numbers)
    assert "+20.0" in refusal.value.what.replace("+19.9", "+20.0")


def is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def test_a_frame_of_uncertainty_is_no_contradiction(trial, fit):
    found = fit(trial, **led(trial, 0.1, late_s=0.002, sigma_s=0.001))
    assert found.sync_events[0].difference_s == pytest.approx(-0.002, abs=3e-4)


def test_the_logs_sync_output_is_an_event(trial, fit):
    flags = trial.log.flags.copy()
    rise = int(np.searchsorted(trial.log.time_s, trial.robot_s(0.1)))
    flags[rise : rise + 20] |= SYNC_HIGH
    log = dataclasses.replace(trial.log, flags=flags)
    found = fit(trial, log=log, settings=in_video(SYNC_OUTPUT, 0.1, 1e-3))
    assert found.sync_events[0].robot_time_s == pytest.approx(trial.robot_s(0.1), abs=0.0011)


def test_an_event_missing_from_the_log_is_refused(trial, fit):
    with pytest.raises(StrandcastError, match="SC-A018") as refusal:
        fit(trial, **led(trial, 0.1, kind="trigger"))
    assert "trigger at" in refusal.value.what


def test_without_motion_an_event_alone_gives_the_offset(throw, fit, motion):
    trial = throw(2, motion=motion(lambda t: np.tile(STILL, (len(t), 1))))
    found = fit(trial, **led(trial, 0.3, sigma_s=5e-4))
    assert found.source == "event"
    assert found.middle_se_s == pytest.approx(5e-4, rel=0.01)
    assert abs(float(found.robot_time_s(np.array(0.3))) - trial.robot_s(0.3)) < 1e-6
    assert "rests on 1 sync event" in found.warnings[0]


@pytest.mark.parametrize(
    ("in_log", "what"),
    [
        ((("led_on", 5.0), ("led_on", 7.0), ("led_off", 7.2)), "has several counterparts"),
        ((("led_on", 5.0), ("led_off", 7.2)), "from the clock by all 2 events"),
    ],
)
def test_events_alone_that_do_not_agree_are_refused(throw, fit, motion, in_log, what):
    trial = throw(2, motion=motion(lambda t: np.tile(STILL, (len(t), 1))))
    recorded = [SyncEvent(kind=kind, time_s=time_s) for kind, time_s in in_log]
    in_both = [in_video("led_on", 1.0, 1e-3).sync_events[0], in_video("led_off", 1.2, 1e-3).sync_events[0]]
    with pytest.raises(StrandcastError, match=f"SC-A018.*{what}"):
        fit(trial, settings=AlignSettings(sync_events=in_both), sync_events=recorded)
