"""What one throw says against the arm's file, the hand's markers and the plane: faults, and refusals."""

import numpy as np

from strandcast.core.pose import rotated
from strandcast.errors import StrandcastError
from strandcast.records.record import ARM_FILE, RigFault
from strandcast.rig.model import SURE_SD, Rig, RigError, RigPriors

# Chosen: an arm's file that is wrong by more is refused.
LARGEST_LENGTH_M = 0.010
LARGEST_TURN_RAD = 0.15


# Where constants of the rig are stated: what a wrong one costs, and what to do.
ARM = {
    "field": ARM_FILE,
    "cost": "plans aim with a wrong arm: hand and tip pass beside where they were planned",
    "fix": "check the arm's and the experiment's files",
}
PLANE = {
    "field": "camera.plane",
    "cost": "the camera's places are not the robot's: the string, and the miss, are seen elsewhere",
    "fix": "measure size and places of the plane's markers, and where the arm's base is among them",
}
HAND = {
    "field": "markers.hand",
    "cost": "the hand is seen elsewhere",
    "fix": "measure place_m of markers.hand in the arm's file",
}


def rig_faults(error: RigError, rig: Rig, priors: RigPriors) -> list[RigFault]:
    """Return the rig's constants that deviate by more than `SURE_SD` standard deviations of their priors."""
    base_m, reach_m = float(np.linalg.norm(error.base_m)), float(rig.chain.lengths_m.sum())
    zero_rad, longer_m = error.zero_rad, error.length_m
    joint, link = int(np.argmax(np.abs(zero_rad))), int(np.argmax(np.abs(longer_m)))
    stretch = float(np.abs(error.stretch).max())
    found = [
        (
            base_m,
            priors.base_shift_m,
            f"the arm's base lies {base_m * 1e3:.1f} mm from the world's origin",
            PLANE,
        ),
        (
            float(np.abs(zero_rad[joint])),
            priors.joint_zero_rad,
            f"the zero of {rig.joints[joint]} is off by {zero_rad[joint] * 1e3:+.1f} mrad"
            f"{', or the world is rotated' if joint == 0 else ''} "
            f"({abs(zero_rad[joint]) * reach_m * 1e3:.1f} mm at the hand)",
            ARM,
        ),
        (
            float(np.abs(longer_m[link])),
            priors.link_length_m,
            f"the link after {rig.joints[link]} is {longer_m[link] * 1e3:+.1f} mm longer than in the "
            "arm's file",
            ARM,
        ),
        (stretch, priors.stretch, f"the camera's scale is off by {stretch:.2%}", PLANE),
    ]
    moved = np.linalg.norm(error.shift_m, axis=1) / priors.marker_shift_m
    together = float(np.maximum(moved, np.abs(error.turn_rad) / priors.marker_turn_rad).min())
    found.append((together, 1.0, clamp_words(rig, error), ARM))
    for index, name in enumerate(rig.ids if together <= SURE_SD else ()):
        shift_m = float(np.linalg.norm(error.shift_m[index]))
        turn_rad = float(error.turn_rad[index])
        found += [
            (
                shift_m,
                priors.marker_shift_m,
                f"marker {name} sits {shift_m * 1e3:.1f} mm from its place",
                HAND,
            ),
            (
                abs(turn_rad),
                priors.marker_turn_rad,
                f"marker {name} is turned by {turn_rad:+.3f} rad",
                HAND | {"fix": "measure angle_rad of markers.hand in the arm's file"},
            ),
        ]
    return [RigFault(what=words, **place) for size, sd, words, place in found if size > SURE_SD * sd > 0]


def implausible_dimensions(error: RigError, priors: RigPriors) -> bool:
    """Return whether lengths of the arm or positions on the hand are unusually far off."""
    return bool(
        np.abs(error.length_m).max() > SURE_SD * priors.link_length_m
        or np.abs(error.shift_m.mean(axis=0)).max() > SURE_SD * priors.marker_shift_m
        or abs(float(error.turn_rad.mean())) > SURE_SD * priors.marker_turn_rad
    )


def refuse_wrong_dimensions(
    error: RigError, se: np.ndarray, rig: Rig, names: tuple[str, ...], arm_file: str | None
) -> None:
    """Refuse an arm's file with lengths that contradict the video though the paths agree (SC-A015).

    In the fit of `error`, with standard errors `se`, these lengths are almost free.
    """
    inner_m, inner_se_m = error.length_m[:-1], RigError.from_vector(se, rig).length_m[:-1]
    hand_m = error.hand_shift_m(rig.clamp).mean(axis=0)
    wrong_m = float(
        max(
            np.abs(inner_m * (np.abs(inner_m) > SURE_SD * inner_se_m)).max(initial=0.0),
            np.linalg.norm(hand_m),
        )
    )
    if wrong_m > LARGEST_LENGTH_M or abs(float(error.turn_rad.mean())) > LARGEST_TURN_RAD:
        cost = f"the hand's position is wrong by {wrong_m * 1e3:.0f} mm"
        raise wrong_arm_error(length_words(rig, names, error), "", cost, arm_file)


def wrong_arm_error(words: str, off: str, cost: str, arm_file: str | None) -> StrandcastError:
    """Return the refusal of an arm's file with lengths that contradict the video."""
    return StrandcastError(
        "SC-A015",
        f"{off}this arm's file does not fit: {words}",
        file=arm_file,
        field="urdf, clamp, markers.hand",
        cost=cost,
    )


def zero_words(names: tuple[str, ...], joint: int, zero_rad: float) -> str:
    """Return by how much the zero of a joint is wrong, in words."""
    words = f"the zero of {names[joint]} is off by {zero_rad * 1e3:+.0f} mrad ({np.degrees(zero_rad):+.1f}°)"
    return words + (", or the markers of the plane are turned by that angle" if joint == 0 else "")


def length_words(rig: Rig, names: tuple[str, ...], error: RigError) -> str:
    """Return which length is most wrong, in words."""
    inner_m = error.length_m[:-1]
    hand_m = error.hand_shift_m(rig.clamp).mean(axis=0)
    if len(inner_m) and np.abs(inner_m).max() > np.linalg.norm(hand_m):
        inner = int(np.argmax(np.abs(inner_m)))
        nominal_m = rig.chain.lengths_m[inner]
        return (
            f"the link after {names[inner]} is {nominal_m * 1e3:.0f} mm by the file, and "
            f"{(nominal_m + inner_m[inner]) * 1e3:.0f} mm by the video"
        )
    return clamp_words(rig, error)


def clamp_words(rig: Rig, error: RigError) -> str:
    """Return which numbers of the clamp, or of the markers beside it, the video contradicts, with its own.

    A clamp at another angle turns the markers about the place where the string leaves; markers that are
    turned on the hand stay in their places.
    """
    usual, clamp, turn_rad = RigPriors(), rig.clamp, error.turn_rad.mean()
    shift_m = error.hand_shift_m(clamp)
    about_clamp_m = rotated(rig.place_m, turn_rad) - rig.place_m
    words = []
    if abs(turn_rad) > SURE_SD * usual.marker_turn_rad:
        number, file_rad = "angle_rad of markers.hand", float(rig.turn_rad.mean())
        if np.linalg.norm(shift_m - about_clamp_m) <= np.linalg.norm(shift_m):
            number, file_rad, shift_m = "clamp.angle_rad", clamp.angle_rad, shift_m - about_clamp_m
        words = [f"{number} is {file_rad:.3f}, the video says {file_rad + turn_rad:.3f}"]
    off_m = rotated(shift_m.mean(axis=0), np.array(clamp.angle_rad))
    if np.linalg.norm(off_m) > SURE_SD * usual.marker_shift_m or not words:
        file_m = np.array(clamp.offset_m)
        words.append(
            "clamp.offset_m is [{:.4f}, {:.4f}], the video says [{:.4f}, {:.4f}] (or the last link or "
            "place_m of markers.hand is wrong by that)".format(*file_m, *(file_m + off_m))
        )
    return " and ".join(words)
