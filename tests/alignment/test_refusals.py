"""Each mistake of a rig, injected into an otherwise good throw: its code, its words, its fix."""

import dataclasses
import re

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from strandcast.alignment.frame_rate import rate_words
from strandcast.arm.kinematics import hand_pose
from strandcast.config.align import AlignSettings
from strandcast.errors import StrandcastError
from strandcast.rig.faults import refuse_wrong_dimensions, rig_faults
from strandcast.rig.model import Detections, RigError, RigPriors, rig_of
from strandcast_studies.evidence.clock_trials import Faults

STILL = np.array([0.8, 0.5, 0.2])
LOG = "trial-01/joints.csv"


@pytest.fixture(scope="module")
def good(throw):
    return throw(5)


@pytest.fixture(scope="module")
def refusal(fit):
    """Return a function that aligns and returns the refusal."""

    def run(*arguments, **more) -> StrandcastError:
        with pytest.raises(StrandcastError) as caught:
            fit(*arguments, **more)
        return caught.value

    return run


def joints(trial, change):
    return dataclasses.replace(trial.log, q_rad=change(trial.log.q_rad))


def test_the_throw_itself_is_good(good, fit):
    assert fit(good).warnings == []


def test_the_log_of_another_trial(good, throw, refusal):
    found = refusal(good, log=throw(6).log)
    assert (found.code, found.file) == ("SC-A007", LOG)
    assert "the log of another trial" in found.fix


@pytest.mark.parametrize(
    ("order", "holds"), [([1, 0, 2], "joint_2, joint_1, joint_3"), ([2, 0, 1], "joint_3, joint_1, joint_2")]
)
def test_joints_reordered(good, refusal, order, holds):
    found = refusal(good, log=joints(good, lambda q: q[:, order]))
    assert found.code == "SC-A012"
    assert f"the columns hold, in this order: {holds};" in found.fix
    assert f"taken as {holds}, " in found.what


def test_degrees_for_radians(good, refusal):
    found = refusal(good, log=joints(good, np.degrees))
    assert found.code == "SC-A012"
    assert "degrees" in found.what
    assert "mm remain" in found.what


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_the_sign_of_a_joint(good, refusal, joint):
    sign = np.ones(3)
    sign[joint] = -1.0
    found = refusal(good, log=joints(good, lambda q: q * sign))
    assert (found.code, found.field) == ("SC-A012", f"joint_{joint + 1}")


@pytest.mark.parametrize(
    ("longer_m", "words"),
    [
        pytest.param(
            *([0.05, 0, 0], "the link after joint_1 is 350 mm by the file, and 300 mm by the video"),
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            *([0, -0.02, 0], "the link after joint_2 is 230 mm by the file, and 250 mm by the video"),
            marks=pytest.mark.thorough,
        ),
        ([0, 0, 0.04], "or the last link"),
    ],
)
def test_an_arms_file_with_a_wrong_link(good, refusal, arm, longer_m, words):
    chain = arm.chain._replace(lengths_m=arm.chain.lengths_m + np.array(longer_m))
    found = refusal(good, on=dataclasses.replace(arm, chain=chain))
    assert (found.code, found.file) == ("SC-A015", str(arm.path))
    assert words in found.what


def test_an_arms_file_with_a_wrong_zero(good, refusal):
    found = refusal(good, log=joints(good, lambda q: q - np.array([0.03, 0.0, 0.0])))
    assert found.code == "SC-A015"
    assert "the zero of joint_1 is off by +3" in str(found)


@pytest.mark.parametrize(
    ("clamp", "number"),
    [
        (
            {"offset_m": (0.0, 0.03)},
            r"clamp.offset_m is \[0.0000, 0.0300\], the video says \[-?0.00\d+, -?0.00",
        ),
        ({"angle_rad": 0.3}, r"clamp.angle_rad is 0.300, the video says -?0.00"),
        ({"angle_rad": 0.14}, r"clamp.angle_rad is 0.140, the video says -?0.00"),
    ],
)
def test_an_arms_file_with_a_wrong_clamp(good, refusal, arm, clamp, number):
    wrong = dataclasses.replace(arm, clamp=arm.clamp.model_copy(update=clamp))
    found = refusal(good, on=wrong)
    assert found.code == "SC-A015"
    assert re.search(number, found.what)


def test_a_last_link_adds_to_the_markers_in_the_hands_frame(arm):
    """The clamp points back along the link."""
    rig = rig_of(dataclasses.replace(arm, clamp=arm.clamp.model_copy(update={"angle_rad": np.pi})))
    longer, back_m = np.array([0.0, 0.0, 0.008]), np.array([[-0.008, 0.0]] * 2)
    error = dataclasses.replace(RigError.none(rig), length_m=longer, shift_m=back_m)
    with pytest.raises(StrandcastError, match=r"SC-A015.*\n.*wrong by 16 mm"):
        refuse_wrong_dimensions(error, np.ones(len(error.vector())), rig, arm.joints, None)


def test_a_log_cut_before_the_throw(good, refusal, rows):
    found = refusal(good, log=rows(good.log, good.log.time_s < good.log.time_s[0] + 0.48))
    assert (found.code, found.file) == ("SC-A007", LOG)
    assert "ends before the throw" in found.fix


@pytest.mark.parametrize("kept", [0.15, 0.30])
def test_a_log_cut_in_the_throw(good, refusal, rows, kept):
    found = refusal(good, log=rows(good.log, good.log.time_s < good.log.time_s[0] + 0.5 + kept))
    assert (found.code, found.file) == ("SC-A007", LOG)
    assert "while the joints move" in found.what


@pytest.mark.parametrize(
    ("said_hz", "word"), [(30.0, "slow-motion export"), (480.0, "0.96"), (1000.0, "2 times")]
)
def test_a_wrong_frame_rate(good, refusal, said_hz, word):
    columns = good.markers | {"camera_time_s": good.markers["camera_time_s"] * 500.0 / said_hz}
    found = refusal(good, markers=columns)
    assert (found.code, found.field, found.file) == ("SC-V017", "camera.frame_rate_hz", None)
    assert word in found.what
    assert "camera.frame_rate_hz: 500;" in found.fix


@pytest.mark.parametrize(("true_hz", "advised"), [(239.76, "239.76"), (250.1, "250"), (233.333, "233.33")])
def test_the_rate_that_is_set_is_not_advised(true_hz, advised):
    every = Detections(np.arange(9) / 240.0, *[None] * 3)
    assert f"camera.frame_rate_hz: {advised};" in rate_words(every, 240.0 / true_hz)[1]


@pytest.mark.parametrize(("seed", "ramp_s"), [pytest.param(5, 0.5, marks=pytest.mark.thorough), (0, 0.45)])
def test_a_speed_ramp_is_refused(throw, refusal, seed, ramp_s):
    """Every eighth frame of the first and last part, evenly stamped; the hand moves in some of it."""
    trial = throw(seed, frame_rate_hz=240.0)
    frame = trial.markers["frame"]
    all_s = np.arange(frame.max() + 1) / 240.0
    ends = (all_s < ramp_s) | (all_s >= all_s[-1] - ramp_s)
    kept = ~ends | (np.arange(len(all_s)) % 8 == 0)
    seen = kept[frame]
    columns = {name: column[seen] for name, column in trial.markers.items()}
    columns["camera_time_s"] = (np.cumsum(kept) - 1)[columns["frame"]] / 240.0
    found = refusal(trial, markers=columns)
    assert found.code == "SC-V017"
    assert "no single frame rate fits" in found.what
    assert "original film" in found.fix


@pytest.mark.parametrize(("axis", "turned"), [("x_m", np.pi), ("y_m", 0.0)])
def test_a_mirrored_world(good, refusal, axis, turned):
    columns = good.markers | {axis: -good.markers[axis], "angle_rad": turned - good.markers["angle_rad"]}
    found = refusal(good, markers=columns)
    assert found.code == "SC-C027"
    assert f"{axis} of camera.plane.markers" in found.fix


def test_all_joints_counted_the_other_way_are_a_mirror_too(good, refusal):
    found = refusal(good, log=joints(good, np.negative))
    assert found.code == "SC-C027"
    assert "all joints count the other way" in found.fix


def test_no_motion_at_all(throw, refusal, motion):
    found = refusal(throw(motion=motion(lambda t: np.tile(STILL, (len(t), 1)))))
    assert found.code == "SC-A008"
    assert "three quick turns of the hand to and fro" in found.fix


def test_a_video_that_misses_the_throw(good, refusal):
    early = good.markers["camera_time_s"] < 0.2
    found = refusal(good, markers={name: column[early] for name, column in good.markers.items()})
    assert found.code == "SC-A007"


def test_too_few_detections(good, refusal):
    found = refusal(good, markers={name: column[:5] for name, column in good.markers.items()})
    assert found.code == "SC-A004"


def test_a_log_with_few_rows(good, refusal, rows):
    found = refusal(good, log=rows(good.log, np.linspace(0, len(good.log.time_s) - 1, 17).astype(int)))
    assert found.what == "the log has 17 rows, at least 20 are needed"


def test_faults_name_the_joint_and_the_number_to_correct(arm):
    rig = rig_of(arm)
    error = dataclasses.replace(
        RigError.none(rig), zero_rad=np.array([0.0, 0.02, 0.0]), turn_rad=np.array([0.0, 0.2])
    )
    zero, turn = rig_faults(error, rig, RigPriors())
    assert zero.what.startswith("the zero of joint_2 is off by +20.0 mrad")
    assert turn.fix.startswith("measure angle_rad of markers.hand")


def test_a_log_without_the_joints(good, refusal):
    found = refusal(good, log=dataclasses.replace(good.log, joint_names=["a", "b", "c"]))
    assert found.code == "SC-A012"
    assert "has no joint_1, joint_2, joint_3; it has a, b, c" in found.what


def test_an_arm_without_markers(good, refusal, arm):
    assert refusal(good, on=dataclasses.replace(arm, markers=())).code == "SC-C022"


def test_a_motion_that_repeats_itself(good, refusal, fit, rows):
    again = rows(good.log, np.tile(np.arange(len(good.log.time_s)), 2))
    step_s = 0.002
    twice = dataclasses.replace(again, time_s=good.log.time_s[0] + step_s * np.arange(len(again.time_s)))
    assert refusal(good, log=twice).code == "SC-A008"
    near = fit(good, log=twice, settings=AlignSettings(largest_offset_s=0.6))
    assert near.offset_s == pytest.approx(fit(good).offset_s, abs=1e-5)


def test_the_largest_offset_counts_from_the_first_frame(good, refusal, fit):
    later = {**good.markers, "camera_time_s": good.markers["camera_time_s"] + 1.0}
    apart_s = good.log.time_s[0] - (good.offset_s - 1.0)
    found = refusal(good, markers=later, settings=AlignSettings(largest_offset_s=apart_s - 0.05))
    assert (found.code, found.field) == ("SC-A007", "align.largest_offset_s")
    assert f"the recordings start {apart_s:.2f} s apart" in found.what
    assert fit(good, markers=later, settings=AlignSettings(largest_offset_s=apart_s + 0.05)).warnings == []


@pytest.fixture(scope="module")
def even(arm, motion):
    """A hand that moves 0.3 m/s along one line, its direction kept, but for the first and last 50 ms."""
    along = np.linspace(0.0, 0.3, 40)
    postures, posture = [], np.array([-1.4, 1.4, 0.0])
    for done in along:
        aim = np.array([0.45, -0.15 + done, 0.0])
        posture = least_squares(
            lambda q, aim=aim: hand_pose(arm.chain, arm.clamp, q).array() - aim, posture
        ).x
        postures.append(posture)
    path = CubicSpline(along, postures)

    def angles(time_s):
        speed = 0.3 * np.clip(np.minimum(time_s, 1.0 - time_s) / 0.05, 0, 1)
        return path(np.clip(np.cumsum(speed) * (time_s[1] - time_s[0]), 0, 0.3))

    return motion(angles, 1.0)


def test_even_motion_along_a_line_does_not_determine_the_offset(throw, refusal, even):
    trial = throw(3, motion=even)
    since_s = trial.markers["camera_time_s"] * (1 + trial.drift) + trial.offset_s - trial.log.time_s[0] - 0.5
    middle = (since_s > 0.2) & (since_s < 0.9)
    found = refusal(trial, markers={name: column[middle] for name, column in trial.markers.items()})
    assert found.code == "SC-A008"
    assert "sync wiggle" in found.fix
    assert "m/s" in found.cost


def test_a_sync_wiggle_determines_it(throw, fit, error_s, motion):
    """Three turns to and fro of some degrees, as the fix says."""

    def wiggle(time_s):
        shape = np.sin(2 * np.pi * 3 * time_s / 0.6) * np.sin(np.pi * time_s / 0.6) ** 2
        return STILL + np.outer(shape, [0.05, 0.0, 0.15])

    trial = throw(3, motion=motion(wiggle))
    found = fit(trial)
    assert found.middle_se_s < 2e-4
    assert abs(error_s(found, trial)) < 4 * found.middle_se_s


def test_a_weak_motion_is_warned_of_with_its_cost(throw, fit, motion):
    def slow(time_s):
        s = np.clip(time_s / 0.9, 0, 1)
        return STILL + np.outer(10 * s**3 - 15 * s**4 + 6 * s**5, [0.15, 0.1, 0.0])

    trial = throw(4, motion=motion(slow, 0.9), faults=Faults(slow_px=(0.1, 0.1), slow_s=(0.08, 0.08)))
    found = fit(trial, tip_speed_m_s=8.0)
    assert 2.5e-4 < found.middle_se_s < 1.02e-3
    [warning] = [one for one in found.warnings if "the offset is known to" in one]
    assert f"{1.96 * found.middle_se_s * 8e3:.1f} mm at a tip's 8.0 m/s" in warning
    assert "sync wiggle" in warning


@pytest.mark.thorough
def test_a_worse_one_is_refused(throw, refusal, motion):
    def slower(time_s):
        s = np.clip(time_s / 0.9, 0, 1)
        return STILL + np.outer(10 * s**3 - 15 * s**4 + 6 * s**5, [0.05, 0.03, 0.0])

    found = refusal(
        throw(4, motion=motion(slower, 0.9), faults=Faults(slow_px=(0.1, 0.1))), tip_speed_m_s=8.0
    )
    assert found.code == "SC-A008"
    assert "mm at a tip's 8.0 m/s" in found.cost
