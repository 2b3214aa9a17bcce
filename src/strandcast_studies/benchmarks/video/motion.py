"""Draw a random throw with the tip speed of a case that stays in the picture."""

import numpy as np

from strandcast.arm.kinematics import link_points
from strandcast.arm.load import PlanarArm
from strandcast.core.box import Box
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import StrandcastError
from strandcast.lab.servo import CYCLE_S
from strandcast.lab.strings import PhysicalString
from strandcast.lab.swing import LabSwing, simulate_swing
from strandcast.lab.variation import ThrowVariation
from strandcast.seeds import rng
from strandcast_studies.benchmarks.video.cases import TIP_SPEEDS_M_S, VideoCase
from strandcast_studies.benchmarks.video.truth import self_crossings

SERVO = "stiff"
STEP_S = 0.002
LONGEST_S, SHORTEST_S = 0.55, 0.30
BACK_SHARE = 0.6  # largest backswing, as a share of the swing
DRAWS, RESIZINGS = 20_000, 4
LIMIT_SHARE = 0.95  # of the arm's limits of speed and acceleration, used by the largest motion
FIRST_HAND_M_S = {"gentle": 1.2, "brisk": 3.0, "violent": 4.5}  # the hand's peak speed in the first try
ROUGH_STEP_S = 5e-4  # of the simulation by which motions are chosen
INSIDE_SHARE = 0.93  # of the string's nodes, over the filmed frames
FILMED_AFTER_S = 0.2
CLEAR_FRAMES = 0.7  # least share of the filmed frames in which ...
CLEAR_NODES = 0.8  # ... this share of the string's nodes is clear of the arm, with the radii below
LARGEST_BEND_RAD = np.radians(150.0)  # of a hinge of the lab's chain; no real string bends as sharply
EVERY_CROSSING = 8  # simulated steps between checks for crossings
ARM_RADIUS_M, HAND_RADIUS_M = 0.022, 0.035
LEAST_HAND_M = 0.25  # distance of the hand from the base: a folded arm hides the string


Moves = list[tuple[float, float, np.ndarray]]  # start and end as shares of the motion; angles (J,) [rad]


def draw_swing(
    case: VideoCase, arm: PlanarArm, thread: PhysicalString, variation: ThrowVariation, box: Box
) -> tuple[LabSwing, float]:
    """Return a simulated throw and its motion's duration [s].

    Motions are drawn until one fits: within the arm's limits, arm and string inside the box, the string
    mostly visible, no bend sharper than a real string's, self-crossings where the case requires them, and the
    tip's peak speed in the case's range. Motions that are too slow or too fast are rescaled.

    Raises
    ------
    StrandcastError
        SC-L011 no motion fits.
    """
    random = rng(case.name, case.seed, 1, "bench-motion")
    slowest, fastest = TIP_SPEEDS_M_S[case.speed]
    for _ in range(DRAWS):
        start, moves = _draw_moves(arm, random)
        duration_s = float(random.uniform(SHORTEST_S, LONGEST_S))
        plain = _command(start, moves, duration_s)
        largest = LIMIT_SHARE / _strain(arm, plain)
        size = FIRST_HAND_M_S[case.speed] / _hand_speed(arm, plain)
        for _ in range(RESIZINGS):
            command = _command(start, moves, duration_s, size)
            if size > largest or not _within(arm, command, thread.length_m, box):
                break
            swing = simulate_swing(arm, SERVO, thread, variation, command, ROUGH_STEP_S)
            if not _is_fair(arm, swing, duration_s, box):
                break
            peak = tip_speed(swing)[_filmed(swing, duration_s)].max()
            if slowest <= peak <= fastest:
                if _crosses(swing, duration_s) < case.crossing_s:
                    break
                fine = simulate_swing(arm, SERVO, thread, variation, command)
                if _is_fair(arm, fine, duration_s, box) and _crosses(fine, duration_s) >= case.crossing_s:
                    return fine, duration_s
                break
            size *= float(np.sqrt(slowest * fastest) / peak)
    raise StrandcastError("SC-L011", f"no motion fits {case.name}", fix="draw it from another seed")


def tip_speed(swing: LabSwing) -> np.ndarray:
    """Return the speed of the string's tip (K,) [m/s]."""
    return np.asarray(np.linalg.norm(np.gradient(swing.nodes_m[:, -1], swing.time_s, axis=0), axis=1))


def _draw_moves(arm: PlanarArm, random: np.random.Generator) -> tuple[np.ndarray, Moves]:
    """Return the start (J,) and the moves of a motion."""
    low, high = arm.limits.lower_rad, arm.limits.upper_rad
    while True:
        start = random.uniform(low, high)
        hand = link_points(arm.chain, start)[-1]
        if np.linalg.norm(hand) > LEAST_HAND_M and hand[1] > 0.0:
            break
    sense = random.choice([-1.0, 1.0])
    moves = []
    for back in (-BACK_SHARE * random.uniform(), 1.0):
        # From the shoulder to the wrist, as with a whip: each joint a little later than the one before.
        sizes = random.uniform(0.4, 1.4, len(start))
        ways = back * sense * sizes * random.choice([1, 1, 1, 1, 1, -1], len(start))
        first, late = (0.0, 0.0) if back < 0 else (random.uniform(0.0, 0.35), random.uniform(0.0, 0.1))
        last = first + random.uniform(0.45, 0.65)
        for joint, way in enumerate(ways):
            turn = np.zeros(len(start))
            turn[joint] = way
            moves.append((first + joint * late, min(1.0, last + joint * late), turn))
    return start, moves


def _command(start: np.ndarray, moves: Moves, duration_s: float, size: float = 1.0) -> JointTrajectory:
    """Return the sum of jerk-limited moves, `size` times as large, from rest to rest."""
    time_s = np.arange(round(duration_s / STEP_S) + 1) * STEP_S
    q = np.tile(start, (len(time_s), 1))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    for first, last, way in moves:
        takes_s = (last - first) * duration_s
        s = np.clip((time_s - first * duration_s) / takes_s, 0.0, 1.0)[:, None]
        q += size * way * s**3 * (10 - 15 * s + 6 * s**2)
        qd += size * way * 30 * s**2 * (1 - s) ** 2 / takes_s
        qdd += size * way * 60 * s * (1 - s) * (1 - 2 * s) / takes_s**2
    return JointTrajectory(time_s, q, qd, qdd)


def _strain(arm: PlanarArm, command: JointTrajectory) -> float:
    """Return the largest share of the arm's limits of speed and acceleration that a motion uses."""
    speed = np.abs(command.qd_rad_s) / arm.limits.velocity_rad_s
    acceleration = np.abs(command.qdd_rad_s2) / arm.limits.acceleration_rad_s2
    return float(max(speed.max(), acceleration.max()))


def _hand_speed(arm: PlanarArm, command: JointTrajectory) -> float:
    """Return the hand's peak speed [m/s]."""
    step = np.diff(link_points(arm.chain, command.q_rad)[:, -1], axis=0)
    return float(np.linalg.norm(step, axis=1).max() / STEP_S)


def _within(arm: PlanarArm, command: JointTrajectory, length_m: float, box: Box) -> bool:
    limits = arm.limits
    turned = (command.q_rad >= limits.lower_rad) & (command.q_rad <= limits.upper_rad)
    points = link_points(arm.chain, command.q_rad)
    hangs_free = points[0, -1, 1] - length_m > box.y_m[0]
    return bool(hangs_free and turned.all() and _inside_share(points, box) == 1.0)


def _filmed(swing: LabSwing, duration_s: float) -> np.ndarray:
    return np.asarray((swing.time_s > 0) & (swing.time_s < duration_s + FILMED_AFTER_S))


def _is_fair(arm: PlanarArm, swing: LabSwing, duration_s: float, box: Box) -> bool:
    """Return whether the filmed string is visible and bent no more sharply than a real string."""
    filmed = _filmed(swing, duration_s)
    q_rad, nodes_m = swing.q_rad[filmed], swing.nodes_m[filmed]
    return bool(
        _inside_share(nodes_m, box) >= INSIDE_SHARE
        and _clear_share(arm, q_rad, nodes_m) >= CLEAR_FRAMES
        and sharpest_bend(nodes_m) <= LARGEST_BEND_RAD
    )


def _crosses(swing: LabSwing, duration_s: float) -> float:
    """Return the filmed time [s] in which the string crosses itself."""
    nodes_m = swing.nodes_m[_filmed(swing, duration_s)][::EVERY_CROSSING]
    return sum(bool(self_crossings(nodes, swing.places_m)) for nodes in nodes_m) * EVERY_CROSSING * CYCLE_S


def sharpest_bend(nodes_m: np.ndarray) -> float:
    """Return the largest turn [rad] between neighbouring links of a chain (T, N, 2), unwound at its start.

    Turns are unwrapped through time, so that a hinge can wind past half a turn.
    """
    steps = np.diff(nodes_m, axis=1)
    turn = np.diff(np.arctan2(steps[..., 1], steps[..., 0]), axis=1)
    first = (turn[0] + np.pi) % (2.0 * np.pi) - np.pi
    return float(np.abs(np.unwrap(turn, axis=0) + first - turn[0]).max())


def _clear_share(arm: PlanarArm, q_rad: np.ndarray, nodes_m: np.ndarray) -> float:
    """Return the share of frames, (F, J) and (F, N, 2), in which most of the string is clear of the arm."""
    points = link_points(arm.chain, q_rad)
    radii = np.full(points.shape[1] - 1, ARM_RADIUS_M)
    radii[-1] = HAND_RADIUS_M
    clear = np.ones(nodes_m.shape[:2], bool)
    for k, radius in enumerate(radii):
        start, step = points[:, None, k], (points[:, k + 1] - points[:, k])[:, None]
        along = ((nodes_m - start) * step).sum(axis=2) / (step**2).sum(axis=2)
        foot = start + np.clip(along, 0.0, 1.0)[..., None] * step
        clear &= np.linalg.norm(nodes_m - foot, axis=2) > radius
    return float((clear.mean(axis=1) > CLEAR_NODES).mean())


def _inside_share(places_m: np.ndarray, box: Box) -> float:
    low, high = np.array([box.x_m, box.y_m]).T
    return float(((places_m >= low) & (places_m <= high)).all(axis=-1).mean())
