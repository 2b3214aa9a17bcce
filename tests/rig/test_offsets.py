"""What an arm's file states wrongly is found from trials of known truth; where nothing is, nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.lab.tracked_points import TrackerNoise, with_tracker_noise
from strandcast.planning.bezier import Curve, rest_heights, sample
from strandcast.records.estimate import RigOffsets
from strandcast.rig import offsets as rig_offsets
from strandcast.rig.offsets import HandSeen, OffsetFit, fit_offsets
from strandcast.rig.words import StringInClamp, rig_offsets_record

NAMES = ["link 1", "link 2", "clamp, along", "clamp, across", *(f"zero of joint_{k}" for k in (1, 2, 3))]
STEP_S = 0.002
FILMED = TrackerNoise(white_m=1e-4, slow_m=1.7e-4, slow_s=0.02)  # what alignments of filmed throws leave
PLANE_SD_M = 3e-4


@pytest.fixture(scope="module")
def arm(project_root: Path) -> PlanarArm:
    return load_arm(project_root / "config/arms/planar3.toml").planar()


def off_by(**numbers: float) -> np.ndarray:
    """Return deviations in the order of `NAMES`, e.g. link_2=0.004."""
    return np.array(
        [
            numbers.get(name.replace("zero of ", "").replace(", ", "_").replace(" ", "_"), 0.0)
            for name in NAMES
        ]
    )


def wild(random: np.random.Generator) -> np.ndarray:
    """Return the joints (T, J) of a random motion, half a second at rest before and after it."""
    start = random.uniform([0.5, -1.5, -1.0], [2.5, 1.5, 1.0])
    q_rad = sample(Curve(start, 0.6, rest_heights(random.normal(0.0, 5.0, (3, 4)))), STEP_S).q_rad
    return np.concatenate([np.tile(q_rad[0], (50, 1)), q_rad, np.tile(q_rad[-1], (100, 1))])


def shoulder_only(_: np.random.Generator) -> np.ndarray:
    """Return a motion of the first joint alone, with a right angle at the second.

    In the hand's frame a longer link 1 is then a turn of joint 2 or a clamp to the right: 0.4 m from it.
    """
    swing = 1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 400))
    return np.column_stack([swing, np.full(400, np.pi / 2), np.zeros(400)])


def thrown(
    arm: PlanarArm, true: np.ndarray, seed: int, count: int, motion=wild, scatter_rad=1e-3, noise=FILMED
):  # type: ignore[no-untyped-def]
    """Return trials of an arm that is off by `true`, before a plane that is shifted, turned and stretched."""
    random = np.random.default_rng(seed)
    base_m, turn_rad, (along_x, along_y, shear) = (random.normal(0.0, 1e-3, n) for n in (2, 1, 3))
    trials = []
    for _ in range(count):
        q_rad = motion(random)
        time_s = np.arange(len(q_rad)) * STEP_S
        zeros_rad = random.normal(0.0, scatter_rad, 3)
        x, y = rig_offsets._hand_m(arm, q_rad + zeros_rad, true).T
        hand_m = (
            np.column_stack(
                [x - turn_rad * y + along_x * x + shear * y, y + turn_rad * x + along_y * y + shear * x]
            )
            + base_m
        )
        hand_m = with_tracker_noise(hand_m[:, None], STEP_S, noise, random)[:, 0]
        there = np.isfinite(hand_m).all(axis=1)
        trials.append(HandSeen(time_s[there], hand_m[there], q_rad[there]))
    return trials


def fitted(arm: PlanarArm, true: np.ndarray, seed: int, count: int, **others: object) -> OffsetFit:
    fit = fit_offsets(arm, thrown(arm, true, seed, count, **others), PLANE_SD_M)
    assert fit is not None
    return fit


@pytest.mark.parametrize(
    ("numbers", "count"),
    [
        ({"link_2": 0.004}, 2),
        ({"link_1": -0.004}, 2),
        ({"clamp_across": 0.005}, 3),
        ({"clamp_along": -0.005}, 2),
        ({"joint_2": 0.010}, 3),
        ({"joint_2": -0.005}, 8),
        ({"link_2": 0.005, "clamp_across": -0.006}, 3),
    ],
)
def test_what_is_wrong_is_named_with_its_size(arm: PlanarArm, numbers: dict[str, float], count: int) -> None:
    true = off_by(**numbers)
    for seed in range(3):
        fit = fitted(arm, true, seed, count)
        np.testing.assert_array_equal(fit.wrong, true != 0.0)
        assert (np.abs(fit.if_wrong[:, 0] - true) < 3.0 * fit.if_wrong[:, 1])[true != 0.0].all()
        assert not fit.possible.any()


def test_three_wrong_zeros_are_measured_within_their_errors_or_not_at_all(arm: PlanarArm) -> None:
    true = off_by(joint_1=0.0087, joint_2=-0.0087, joint_3=0.0087)
    for seed in range(3):
        fit = fitted(arm, true, seed, 3)
        alone, known = fit.alone, np.isfinite(fit.alone[:, 0])
        # 10 mrad of the last joint are 1.5 mm of the clamp across: no motion distinguishes them.
        np.testing.assert_array_equal(known, [True, True, True, False, True, True, False])
        assert (np.abs(alone[:, 0] - true) < 3.5 * alone[:, 1])[known].all()
        assert (alone[known, 1] < 3e-3).all()
        likeliest = fit.sets[np.argmax(fit.probability)]
        assert {"zero of joint_1", "zero of joint_2"} <= {NAMES[k] for k in np.flatnonzero(likeliest)}
        record = rig_offsets_record(arm, [1, 2, 3], fit)
        assert [one.value is None for one in record.numbers] == (~known).tolist()


@pytest.mark.thorough
def test_an_arm_as_its_file_says_is_never_accused(arm: PlanarArm) -> None:
    fits = [fitted(arm, off_by(), 100 + seed, 2 + seed % 3) for seed in range(40)]
    assert not any(fit.wrong.any() or fit.possible.any() for fit in fits)
    assert np.median([fit.probability[0] for fit in fits]) > 0.7


@pytest.mark.thorough
def test_stated_standard_deviations_are_those_of_the_errors(arm: PlanarArm) -> None:
    true = off_by(link_2=0.006, joint_1=-0.008)
    fits = [fitted(arm, true, 200 + seed, 3) for seed in range(40)]
    z = np.array([(fit.alone[:, 0] - true) / fit.alone[:, 1] for fit in fits])[:, [0, 1, 2, 4, 5]]
    size = np.sqrt((z**2).mean(axis=0))
    assert (size < 1.4).all()
    assert (size > 0.5).all()  # and not much too large
    assert np.abs(z).max() < 4.0


def test_a_link_and_a_zero_that_motions_cannot_tell_apart_are_both_named(arm: PlanarArm) -> None:
    for seed in range(3):
        trials = thrown(arm, off_by(link_1=0.005), seed, 3, motion=shoulder_only)
        fit = fit_offsets(arm, trials, PLANE_SD_M)
        assert fit is not None
        assert not fit.wrong.any()
        assert {"link 1", "zero of joint_2"} <= {NAMES[k] for k in np.flatnonzero(fit.possible)}
        np.testing.assert_allclose(fit.if_wrong[[0, 5], 0], [0.005, -0.0125], rtol=0.35)
        assert np.isnan(fit.alone[[0, 3, 5]]).all()
        (warning,) = rig_offsets_record(arm, [1, 2, 3], fit).warnings
        assert "cannot tell which number is wrong" in warning
        assert "link 1 is" in warning
        assert "joint_2 reads" in warning
    # Motions of all joints tell them apart.
    assert fitted(arm, off_by(link_1=0.005), 0, 3).wrong[0]


def test_one_trial_or_a_short_look_is_not_enough(arm: PlanarArm) -> None:
    trials = thrown(arm, off_by(link_2=0.004), 0, 2)
    assert fit_offsets(arm, trials[:1], PLANE_SD_M) is None
    short = HandSeen(*(values[:40] for values in trials[1]))
    assert fit_offsets(arm, [trials[0], short], PLANE_SD_M) is None


@pytest.mark.thorough
def test_zeros_that_scatter_noise_that_lasts_and_a_poor_plane_widen_the_errors(arm: PlanarArm) -> None:
    true = off_by()

    def sd(plane_sd_m: float = PLANE_SD_M, **others: object) -> np.ndarray:
        fits = [fit_offsets(arm, thrown(arm, true, seed, 4, **others), plane_sd_m) for seed in range(4)]
        return np.mean([np.sqrt(np.diag(fit.covariance)) for fit in fits if fit is not None], axis=0)

    usual = sd()
    assert (sd(scatter_rad=4e-3)[4:6] > 1.4 * usual[4:6]).all()
    lasting = TrackerNoise(white_m=1e-4, slow_m=4e-4, slow_s=0.2)
    brief = TrackerNoise(white_m=1e-4, slow_m=4e-4, slow_s=0.002)
    assert (sd(noise=lasting)[:3] > 1.25 * sd(noise=brief)[:3]).all()
    assert (sd(5e-3)[:2] > 1.2 * usual[:2]).all()


@pytest.mark.thorough
def test_errors_that_last_are_not_the_arms_fault(arm: PlanarArm) -> None:
    lasting = TrackerNoise(white_m=1e-4, slow_m=4e-4, slow_s=0.3)
    fits = [fitted(arm, off_by(), 300 + seed, 2, noise=lasting) for seed in range(12)]
    assert not any(fit.wrong.any() or fit.possible.any() for fit in fits)


def test_a_plane_that_lies_elsewhere_is_not_the_arms_fault(arm: PlanarArm) -> None:
    trials = thrown(arm, off_by(), 0, 3)
    moved = [one._replace(hand_m=one.hand_m + np.array([0.003, -0.002])) for one in trials]
    fit = fit_offsets(arm, moved, PLANE_SD_M)
    assert fit is not None
    assert not fit.wrong.any()


def described(arm: PlanarArm, string: StringInClamp | None = None, **numbers: float) -> RigOffsets:
    """Return the record of a fit that is sure of these numbers: ± 1.2 mm or mrad."""
    value = off_by(**numbers)
    sets, square = np.array([np.zeros(7, bool), value != 0.0]), np.diag(np.full(7, 1.2e-3**2))
    fit = OffsetFit(
        value,
        square,
        np.full(7, 5e-3),
        sets,
        np.array([0.001, 0.999]) if numbers else np.array([1.0, 0.0]),
        np.array([np.zeros(7), value]),
        np.array([square, square]),
        rig_offsets._moves(arm, np.array([[0.0, 0.0, 0.0]]), np.zeros(7)),
        1e-3,
    )
    return rig_offsets_record(arm, [1, 2], fit, string)


def test_a_wrong_number_is_told_with_what_to_change(arm: PlanarArm) -> None:
    (link,) = described(arm, link_2=0.0041).warnings
    assert link == (
        "link 2 is 4.1 ± 1.2 mm longer than the arm's file says, which moves the hand by up to 4.1 mm: "
        "measure it from joint_2 to joint_3; in planar3.urdf these are 250.0 mm apart (<origin>), by the "
        "video 254.1 mm"
    )
    (clamp,) = described(arm, clamp_across=-0.005).warnings
    assert "the clamp is 5.0 ± 1.2 mm to the right of where the arm's file has it" in clamp
    assert "clamp.offset_m[1] in planar3.toml is 0.0000, by the video -0.0050" in clamp
    (zero,) = described(arm, joint_2=0.005).warnings
    # 0.25 m of link 2 and 0.15 m of link 3, stretched out, by 5 mrad.
    assert "joint_2 reads 5.0 ± 1.2 mrad too little, which moves the hand by up to 2.0 mm" in zero
    assert "turn its <origin> in planar3.urdf by +5.0 mrad" in zero
    (first,) = described(arm, joint_1=-0.005).warnings
    assert first.endswith("or the markers of the plane are turned by that angle")
    assert described(arm).warnings == []


def test_small_numbers_are_not_told(arm: PlanarArm) -> None:
    assert described(arm, joint_3=0.005).warnings == []  # 0.75 mm at the hand


def test_where_the_string_leaves_the_hand_is_compared_too(arm: PlanarArm) -> None:
    left_m, error_m = np.array([0.0048, 0.0052, 0.0050]), np.full(3, 2e-4)
    record = described(arm, StringInClamp(left_m, error_m, (0.02, 0.01), 0.03))
    across, direction = record.numbers[-2:]
    assert across.state == "wrong"
    np.testing.assert_allclose(across.value, 0.005)
    assert 0.0003 < across.sd < 0.0010  # three grasps that differ by 0.2 mm, expected: 1 mm
    assert "clamp.offset_m in planar3.toml is [0.0000, 0.0000], by the video [0.0000, 0.0050]" in across.fix
    turned = replace(arm, clamp=arm.clamp.model_copy(update={"angle_rad": np.pi / 2}))
    across = described(turned, StringInClamp(left_m, error_m, None, 0.03)).numbers[-1]
    assert "by the video [-0.0050, 0.0000]; then add -5.0 mm to place_m" in across.fix
    # Three grasps differ by 3 degrees each.
    assert direction.state == "right"
    np.testing.assert_allclose(direction.sd, 0.034, atol=2e-3)
    poorly = StringInClamp(left_m, np.full(3, 2e-3), None, 0.03)  # alike in all trials
    assert described(arm, poorly).numbers[-1].state == "right"
    unseen = StringInClamp(np.full(2, np.nan), np.full(2, np.nan), None, 0.03)
    assert [one.name for one in described(arm, unseen).numbers] == NAMES
