"""Deviations from an arm's file as a record: each number in words, and what to change in which file."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from strandcast.arm.load import PlanarArm
from strandcast.core.pose import rotated
from strandcast.records.estimate import RigOffset, RigOffsets
from strandcast.records.record import ARM_FILE, RigFault
from strandcast.rig.model import SURE_SD
from strandcast.rig.offsets import WORTH_M, OffsetFit
from strandcast.rig.unknown_size import SizePrior, prior_of, size_posterior

# Chosen: grasps of one clamp differ by this much across and in direction, one standard deviation, two rigs in
# three within the factor.
ASIDE, TURNED = SizePrior(1e-3, 2.0), SizePrior(0.035, 2.0)


class StringInClamp(NamedTuple):
    """How the string leaves the hand, by trial: to the left of the markers' hand (N,) [m], standard errors.

    `direction_rad` is the fitted turn in the clamp and its standard deviation, None if it was not fitted, and
    `point_m` the distance along the string over which it counts.
    """

    left_m: np.ndarray
    error_m: np.ndarray
    direction_rad: tuple[float, float] | None
    point_m: float


def rig_offsets_record(
    arm: PlanarArm, trials: Sequence[int], fit: OffsetFit, string: StringInClamp | None = None
) -> RigOffsets:
    """Return the deviations as a record, with a warning for each number that is wrong."""
    alone, if_wrong = fit.alone, fit.if_wrong
    numbers = [
        RigOffset(
            name=name,
            unit="rad" if angle else "m",
            value=None if np.isnan(alone[k, 0]) else float(alone[k, 0]),
            sd=None if np.isnan(alone[k, 0]) else float(alone[k, 1]),
            hand_m=fit.hand_m(np.where(np.arange(len(if_wrong)) == k, if_wrong[:, 0], 0.0)),
            wrong_probability=float(fit.probability @ fit.sets[:, k]),
            state="wrong" if fit.wrong[k] else "possible" if fit.possible[k] else "right",
            says=says.format(size=_size(*if_wrong[k], angle=angle)),
            fix=fix,
        )
        for k, (name, angle, says, fix) in enumerate(_words(arm, if_wrong[:, 0]))
    ]
    numbers += [] if string is None else _of_string(arm, string)
    wrong = [one for one in numbers if one.state == "wrong"]
    faults = [
        _fault(f"{one.says}, which moves the hand by up to {1e3 * one.hand_m:.1f} mm", one.fix)
        for one in wrong
    ] + _undecided(arm, fit)
    return RigOffsets(
        trials=list(trials),
        right_probability=float(fit.probability[0]),
        together_m=fit.together_m,
        zero_scatter_rad=fit.zero_scatter_rad,
        numbers=numbers,
        faults=faults,
        warnings=[fault.words for fault in faults],
    )


def _fault(what: str, fix: str) -> RigFault:
    return RigFault(
        what=what,
        cost="first motions aim with a wrong arm; near thrown ones the planner makes up for it",
        fix=fix,
        field=ARM_FILE,
    )


def _size(value: float, sd: float, *, angle: bool) -> str:
    return f"{1e3 * abs(value):.1f} ± {1e3 * sd:.1f} {'mrad' if angle else 'mm'}"


def _words(arm: PlanarArm, value: np.ndarray) -> Iterator[tuple[str, bool, str, str]]:
    """Yield of each number its name, whether it is an angle, what is wrong with it, and the fix."""
    joints, toml, urdf = arm.joints, arm.path.name, arm.urdf_path.name
    links, clamp, zeros = np.split(value, [len(joints) - 1, len(joints) + 1])
    for k, off_m in enumerate(links):
        length_m, ends = arm.chain.lengths_m[k], f"{joints[k]} to {joints[k + 1]}"
        yield (
            f"link {k + 1}",
            False,
            f"link {k + 1} is {{size}} {'longer' if off_m > 0 else 'shorter'} than the arm's file says",
            f"measure it from {ends}; in {urdf} these are {1e3 * length_m:.1f} mm apart (<origin>), by the "
            f"video {1e3 * (length_m + off_m):.1f} mm",
        )
    sides = (("farther out than", "nearer than"), ("to the left of", "to the right of"))
    for k, (name, off_m, side) in enumerate(zip(("along", "across"), clamp, sides, strict=True)):
        stated_m = arm.clamp.offset_m[k]
        now = f"{stated_m:.4f}, by the video {stated_m + off_m:.4f}"
        other = f", or the last link in {urdf}" if k == 0 else ""
        yield (
            f"clamp, {name}",
            False,
            f"the clamp is {{size}} {side[0] if off_m > 0 else side[1]} where the arm's file has it",
            f"measure it; clamp.offset_m[{k}] in {toml} is {now} (if a ruler says "
            f"{stated_m:.4f}: correct place_m of markers.hand{other})",
        )
    for k, off_rad in enumerate(zeros):
        plane = ", or the markers of the plane are turned by that angle" if k == 0 else ""
        yield (
            f"zero of {joints[k]}",
            True,
            f"{joints[k]} reads {{size}} too {'little' if off_rad > 0 else 'much'}",
            f"calibrate its zero, or turn its <origin> in {urdf} by {1e3 * off_rad:+.1f} mrad about its axis"
            f"{plane}",
        )


def _undecided(arm: PlanarArm, fit: OffsetFit) -> list[RigFault]:
    """Return the fault that is one number explanations, another by others; none if all may be right."""
    explanations, shared = fit.explanations, fit.wrong
    if not explanations or any((fit.sets[h] == shared).all() for h in explanations):
        return []
    either = []
    for h in explanations:
        words, sd = list(_words(arm, fit.given[h])), np.sqrt(np.diag(fit.given_covariance[h]))
        some = np.flatnonzero(fit.sets[h] & ~shared)
        either.append(
            " and ".join(
                words[k][2].format(size=_size(fit.given[h, k], sd[k], angle=words[k][1])) for k in some
            )
        )
    besides = "besides, " if shared.any() else ""
    return [
        _fault(
            f"{besides}the arm's file puts the hand up to {1e3 * fit.together_m:.1f} mm from where it is, in "
            "the same way in all trials, and these motions cannot tell which number is wrong: "
            f"{', or '.join(either)}",
            "measure one of them, or throw a motion that turns the joints more",
        )
    ]


def _of_string(arm: PlanarArm, string: StringInClamp) -> list[RigOffset]:
    """Return how the string leaves the hand, as far as it was seen."""
    toml, known = arm.path.name, np.isfinite(string.left_m) & np.isfinite(string.error_m)
    found = []
    if known.sum() > 1:
        left_m, error_m = string.left_m[known], string.error_m[known]
        scatter_m = size_posterior(ASIDE, left_m[:, None], error_m[:, None]).rms
        # The tracker's errors are alike where motions are: more trials do not average them out.
        sd_m = float(np.sqrt(scatter_m**2 / known.sum() + float(np.mean(error_m**2))))
        value_m = float(left_m.mean())
        stated_m = np.array(arm.clamp.offset_m)
        # The hand is turned by the clamp's angle from the last link, along which the clamp's place counts.
        seen_m = stated_m + rotated(np.array([0.0, value_m]), np.array(arm.clamp.angle_rad))
        side = "left" if value_m > 0 else "right"
        found.append(
            _number(
                "string, across",
                "m",
                (value_m, sd_m),
                abs(value_m),
                f"the string leaves the hand {_size(value_m, sd_m, angle=False)} to the {side} of where its "
                "markers put the clamp",
                f"measure it; clamp.offset_m in {toml} is {_pair(stated_m)}, by the video {_pair(seen_m)}; "
                f"then add {-1e3 * value_m:+.1f} mm to place_m of markers.hand, across",
            )
        )
    if string.direction_rad is not None and known.sum() > 1:
        value, error_rad = string.direction_rad
        sd = float(np.hypot(error_rad, prior_of(TURNED).rms / np.sqrt(known.sum())))
        stated = arm.clamp.angle_rad
        found.append(
            _number(
                "string, direction",
                "rad",
                (value, sd),
                abs(value) * string.point_m,
                f"the string leaves the hand turned by {_size(value, sd, angle=True)} "
                f"{'counter-clockwise' if value > 0 else 'clockwise'} from the arm's file",
                f"measure it; clamp.angle_rad in {toml} is {stated:.3f}, by the fit {stated + value:.3f}",
            )
        )
    return found


def _pair(place_m: np.ndarray) -> str:
    return "[{:.4f}, {:.4f}]".format(*place_m)


def _number(
    name: str, unit: str, known: tuple[float, float], hand_m: float, says: str, fix: str
) -> RigOffset:
    """Return a number of value and standard deviation, which displaces the string by `hand_m`."""
    value, sd = known
    return RigOffset(
        name=name,
        unit=unit,
        value=value,
        sd=sd,
        hand_m=hand_m,
        state="wrong" if abs(value) > SURE_SD * sd and hand_m > WORTH_M else "right",
        says=says,
        fix=fix,
    )
