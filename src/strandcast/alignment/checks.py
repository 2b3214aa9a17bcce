"""What is refused before and after the fit, and what is warned of."""

from __future__ import annotations

import numpy as np

from strandcast.alignment.diagnosis import cut_log, length_words, rate_words, wrong_arm
from strandcast.alignment.fit import SHIFT_S, Candidate, ClockFit
from strandcast.alignment.problem import Priors
from strandcast.alignment.rig import Rig, Seen
from strandcast.alignment.rows import MOVES, Rows, hand_travel_m
from strandcast.arm.load import Arm
from strandcast.errors import StrandcastError

LEAST_SIGHTINGS = 20
LEAST_TRAVEL_M = 0.02
PLAIN_RESIDUAL_M = 0.001  # beyond it, something is a little wrong
LARGEST_CI_S = 0.002  # half the 95 % interval
WEAK_CI_S = 0.0005
NORMAL = 1.96
DRIFT_TOLD = 1e-4
LARGEST_DRIFT = 0.03
LONGEST_UNSEEN_S = 0.03  # of motion in the video without a log
LARGEST_LENGTH_M = 0.010
LARGEST_TURN_RAD = 0.15
WRONG_SHARE = 0.10  # of a marker's sightings, or of the log's rows
NOISY = 4.0  # times as noisy as the best marker
WIGGLE = "play a sync wiggle before the throw: three quick turns of the hand to and fro, some centimetres"


def refuse_few(seen: Seen) -> None:
    """Refuse a video that hardly shows the hand (SC-A004)."""
    if len(seen.time_s) < LEAST_SIGHTINGS:
        raise StrandcastError(
            "SC-A004",
            f"the video shows the hand's markers {len(seen.time_s)} times, at least {LEAST_SIGHTINGS} are "
            "needed",
            fix="check the marker ids in the arm's file, light, focus and exposure",
        )


def still(seen: Seen, rows: Rows, arm: Arm, file: str | None) -> StrandcastError | None:
    """Return the refusal of a throw without motion in the video, in the log, or in both."""
    seen_m = max(_travel_m(seen.where(seen.marker == marker)) for marker in np.unique(seen.marker))
    told_m = hand_travel_m(rows, arm) if len(rows.time_s) >= LEAST_SIGHTINGS else 0.0
    if min(seen_m, told_m) >= LEAST_TRAVEL_M:
        return None
    if max(seen_m, told_m) < LEAST_TRAVEL_M:
        return StrandcastError(
            "SC-A005",
            f"the hand moves {seen_m * 1e3:.1f} mm in the video and {told_m * 1e3:.1f} mm by the log, "
            f"at least {LEAST_TRAVEL_M * 1e3:.0f} mm are needed",
            file=file,
            cost="the clocks cannot be told from each other",
            fix=WIGGLE,
        )
    if seen_m < told_m:
        return StrandcastError(
            "SC-A006",
            f"the hand moves {seen_m * 1e3:.1f} mm in the video and {told_m * 1e3:.0f} mm by the log",
            cost="the clocks cannot be told from each other",
            fix="the video begins after the throw or ends before it: give the one that shows it",
        )
    return StrandcastError(
        "SC-A011",
        f"the joints do not move in the log ({len(rows.time_s)} rows, "
        f"{rows.time_s[-1] - rows.time_s[0]:.2f} s) while the hand moves {seen_m * 1e3:.0f} mm in the video",
        file=file,
        cost="the clocks cannot be told from each other",
        fix="the log is cut before the throw, or begins after it: copy the whole log of this throw",
    )


def _travel_m(seen: Seen) -> float:
    low, high = np.quantile(seen.pose[:, :2], (0.02, 0.98), axis=0)
    return float(np.linalg.norm(high - low))


def outside(file: str | None) -> StrandcastError:
    """Return the refusal of a video that lies outside the log's time."""
    return StrandcastError(
        "SC-A003",
        f"fewer than {LEAST_SIGHTINGS} sightings of the hand lie within the joint log's time",
        file=file,
        fix="is it this trial's log? record both from before the motion to after it",
    )


def refuse_cut(rows: Rows, seen: Seen, robot_s: np.ndarray, file: str | None) -> None:
    """Refuse a log that begins or ends in mid-throw while the video shows the rest (SC-A010)."""
    speed = seen.speed_m_s()
    fast = speed > MOVES * float(np.quantile(speed, 0.98))
    unseen = fast & ((robot_s < rows.time_s[0]) | (robot_s > rows.time_s[-1]))
    times = np.unique(robot_s[unseen])
    if len(times) > 1 and np.ptp(times) > LONGEST_UNSEEN_S:
        cut = cut_log(rows, file, f"; the video shows {np.ptp(times):.2f} s more of motion")
        if cut is not None:
            raise cut


def refuse_unsure(best: Candidate, speed_m_s: float, whose: str) -> None:
    """Refuse an offset that the motion does not tell (SC-A020), or not well enough (SC-A008)."""
    half_s, unaided_s = NORMAL * best.fit.middle_se_s, NORMAL * best.fit.unaided_se_s
    if best.told and max(half_s, unaided_s) <= LARGEST_CI_S:
        return
    cost = f"{max(half_s, unaided_s) * speed_m_s * 1e3:.0f} mm at {whose} {speed_m_s:.1f} m/s"
    if not best.told or half_s <= LARGEST_CI_S:
        raise StrandcastError(
            "SC-A020",
            "the motion does not tell the offset: the hand moves too evenly, or along one line only; "
            f"{SHIFT_S * 1e3:.0f} ms more would change its path by {best.shape_m * 1e3:.1f} mm beside a "
            f"displacement, and from the motion alone the offset is known to ± "
            f"{unaided_s * 1e3:.1f} ms at best",
            cost=f"at least {cost}",
            fix=WIGGLE,
        )
    raise StrandcastError(
        "SC-A008",
        f"the offset is known to ± {half_s * 1e3:.1f} ms only (95 %), ± {LARGEST_CI_S * 1e3:.0f} ms are "
        "needed",
        cost=cost,
        fix=WIGGLE,
    )


def suspicious(fit: ClockFit, priors: Priors) -> bool:
    """Tell whether lengths of the arm or places on the hand lie beyond what is usual."""
    misfit = fit.misfit
    return bool(
        np.abs(misfit.length_m).max() > 3 * priors.link_length_m
        or np.abs(misfit.shift_m.mean(axis=0)).max() > 3 * priors.marker_shift_m
        or abs(float(misfit.turn_rad.mean())) > 3 * priors.marker_turn_rad
    )


def refuse_constants(wide: ClockFit, rig: Rig, names: tuple[str, ...], arm_file: str | None) -> None:
    """Refuse an arm's file whose lengths the video denies though the paths agree (SC-A015).

    Parameters
    ----------
    wide
        A fit with these lengths all but free.
    """
    misfit, joints = wide.misfit, len(names)
    inner_m, inner_se_m = misfit.length_m[:-1], wide.misfit_se[5 + joints : 5 + 2 * joints - 1]
    hand_m = misfit.shift_m.mean(axis=0) + np.array([misfit.length_m[-1], 0.0])
    wrong_m = float(
        max(np.abs(inner_m * (np.abs(inner_m) > 3 * inner_se_m)).max(initial=0.0), np.linalg.norm(hand_m))
    )
    if wrong_m > LARGEST_LENGTH_M or abs(float(misfit.turn_rad.mean())) > LARGEST_TURN_RAD:
        words = length_words(rig, names, misfit.vector())
        raise wrong_arm(words, "", f"the hand is taken {wrong_m * 1e3:.0f} mm from where it is", arm_file)


def refuse_rate(fit: ClockFit, seen: Seen) -> None:
    """Refuse a camera's clock that is no clock of this throw (SC-A016)."""
    if abs(fit.drift) > LARGEST_DRIFT:
        what, fix = rate_words(seen, 1.0 + fit.drift)
        raise StrandcastError(
            "SC-A016", f"the log fits {what}", field="camera.frame_rate_hz", fix=fix,
            cost=f"{abs(fit.drift):.1%} of every speed",
        )  # fmt: skip


def warnings_of(
    best: Candidate, rig: Rig, rows: Rows, priors: Priors, speed_m_s: float, whose: str
) -> list[str]:
    """Return what a good fit still warns of."""
    fit, seen = best.fit, best.covered
    far = f"the hand in the video stays {best.residual_m * 1e3:.1f} mm rms from where the log puts it"
    return [
        *([far] if best.residual_m > PLAIN_RESIDUAL_M else []),
        *_clock_warnings(fit, seen, priors, speed_m_s, whose),
        *_constant_warnings(fit, rig, priors),
        *_marker_warnings(fit, rig, seen),
        *_row_warnings(rows, int(best.path.wrong.sum())),
    ]


def _clock_warnings(fit: ClockFit, seen: Seen, priors: Priors, speed_m_s: float, whose: str) -> list[str]:
    found = []
    half_s = NORMAL * fit.middle_se_s
    if half_s > WEAK_CI_S:
        found.append(
            f"the offset is known to ± {half_s * 1e3:.2f} ms (95 %): {half_s * speed_m_s * 1e3:.1f} mm at "
            f"{whose} {speed_m_s:.1f} m/s; {WIGGLE}"
        )
    if abs(fit.drift) > DRIFT_TOLD:
        rate = rate_words(seen, 1.0 + fit.drift)[1] if abs(fit.drift) > 1e-3 else "check the camera's rate"
        found.append(
            f"the clocks drift by {fit.drift * 1e6:+.0f} ± {fit.drift_se * 1e6:.0f} ppm "
            f"({fit.drift * 1e3:+.2f} ms in a second): {rate}"
        )
    return found


def _constant_warnings(fit: ClockFit, rig: Rig, priors: Priors) -> list[str]:
    """Tell which of the rig's constants lie beyond three standard deviations of what was expected."""
    misfit = fit.misfit
    base_m, reach_m = float(np.linalg.norm(misfit.base_m)), float(rig.chain.lengths_m.sum())
    zero_rad, longer_m = misfit.zero_rad, misfit.length_m
    joint, link = int(np.argmax(np.abs(zero_rad))), int(np.argmax(np.abs(longer_m)))
    stretch = float(np.abs(misfit.stretch).max())
    found = [
        (base_m, priors.base_shift_m, f"the arm's base lies {base_m * 1e3:.1f} mm from the world's origin"),
        (
            float(np.abs(zero_rad[joint])),
            priors.joint_zero_rad,
            f"the zero of joint {joint + 1} is off by {zero_rad[joint] * 1e3:+.1f} mrad, or the world is "
            f"turned ({abs(zero_rad[joint]) * reach_m * 1e3:.1f} mm at the hand)",
        ),
        (
            float(np.abs(longer_m[link])),
            priors.link_length_m,
            f"the link after joint {link + 1} is {longer_m[link] * 1e3:+.1f} mm longer than the arm's "
            "file says",
        ),
        (stretch, priors.stretch, f"the camera's scale is off by {stretch:.2%}"),
    ]
    for index, name in enumerate(rig.ids):
        shift_m = float(np.linalg.norm(misfit.shift_m[index]))
        turn_rad = float(misfit.turn_rad[index])
        found += [
            (shift_m, priors.marker_shift_m, f"marker {name} sits {shift_m * 1e3:.1f} mm from its place"),
            (abs(turn_rad), priors.marker_turn_rad, f"marker {name} is turned by {turn_rad:+.3f} rad"),
        ]
    return [
        f"{words}: check the arm's and the experiment's files"
        for size, sd, words in found
        if size > 3 * sd > 0
    ]


def _marker_warnings(fit: ClockFit, rig: Rig, seen: Seen) -> list[str]:
    found = []
    best = float(np.nanmin(fit.spread[:, 0]))
    for index, name in enumerate(rig.ids):
        mine = seen.marker == index
        if not mine.any():
            found.append(f"marker {name} is never seen")
            continue
        share = float(fit.wrong[mine].mean())
        if share > WRONG_SHARE:
            found.append(f"{share:.0%} of marker {name}'s sightings are wrong and were left out")
        if fit.spread[index, 0] > NOISY * best:
            found.append(
                f"marker {name} is {fit.spread[index, 0] / best:.0f} times as noisy as the best: is it "
                "loose, or misread?"
            )
    return found


def _row_warnings(rows: Rows, wrong_rows: int) -> list[str]:
    found = []
    if rows.unsorted:
        found.append(f"{rows.unsorted} rows of the log were out of order and were sorted")
    if rows.doubled:
        found.append(f"{rows.doubled} rows of the log have the time of another and were left out")
    if wrong_rows:
        found.append(f"{wrong_rows} rows of the log are late, repeated or wrong and were left out")
    return found
