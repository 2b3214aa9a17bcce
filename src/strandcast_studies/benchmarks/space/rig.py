"""The lab's arm in space as a driver that plays motions, and a motion capture of what it throws."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from strandcast.arm.spatial import hand_path
from strandcast.core.trajectory import JointTrajectory
from strandcast.executor.drivers.protocol import ArmState, Recording
from strandcast.executor.play import play
from strandcast.executor.preflight import PlayOptions, run_preflight
from strandcast.lab.driver import joint_log
from strandcast.lab.strings import EMPTY_CLAMP
from strandcast.lab.swing import BEFORE_S, LabSwing
from strandcast.lab.swing_in_space import VariationInSpace, simulate_swing_in_space
from strandcast.lab.tracked_points import TrackerNoise, points_at, with_tracker_noise
from strandcast.lab.truth import true_miss
from strandcast.lab.variation import LabClocks, draw_variation
from strandcast_studies.benchmarks.loop.throw import FILMED_AFTER_S, FILMED_BEFORE_S, FRAME_RATE_HZ
from strandcast_studies.benchmarks.space.drawn import SpaceCase

# The capture knows neither where the arm stands nor its clock.
CAPTURE_AXES, CAPTURE_ORIGIN_M = Rotation.from_euler("xyz", [0.02, -0.03, 2.1]), np.array([1.7, -0.6, 0.4])
CAPTURE_CLOCK_S = -37.2  # to be added to its times for those of the log
BODY_M = np.array([-0.03, 0.04, 0.01])  # of the tracked body in the hand's axes


class SpaceRig:
    """The virtual rig of one throw (see `strandcast.executor.drivers.protocol.Driver`).

    With `empty` clamp it plays a rehearsal. `swing` and `capture`, the columns of a capture by name [s, mm],
    are what the last motion left.
    """

    name = "lab in space"
    streams = False
    address: str | None = None

    def __init__(self, case: SpaceCase, random: np.random.Generator, *, empty: bool = False) -> None:
        self.rate_hz = case.arm.log_rate_hz
        self._case, self._random, self._empty = case, random, empty
        self._q_rad = np.zeros(len(case.arm.joints))
        self.swing: LabSwing | None = None
        self.capture: dict[str, np.ndarray] = {}

    def connect(self) -> None:
        """Do nothing."""

    def state(self) -> ArmState:
        """Return the arm at rest at its last posture."""
        return ArmState(self._q_rad.copy(), np.zeros_like(self._q_rad))

    def move_to_start(self, q_rad: np.ndarray) -> None:
        """Set the posture to (J,) angles."""
        self._q_rad = np.array(q_rad, float)

    def stop(self) -> None:
        """Do nothing: the virtual arm is at rest between throws."""

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        """Throw, and return the controller's log."""
        case, motion_s = self._case, command.end_s
        along, across = (draw_variation(self._random, len(case.arm.joints), 1.0) for _ in range(2))
        string = case.string
        if self._empty:
            string, along = EMPTY_CLAMP, replace(along, grasp_length_m=0.0)
        swing = simulate_swing_in_space(
            case.arm,
            case.servo,
            string,
            0.0 if self._empty else case.curl_turn_rad,
            VariationInSpace(along, across),
            command,
        )
        clocks = LabClocks(1.0, 0.0, 0.0)
        log = joint_log(case.arm, swing, along, clocks, motion_s, self._random)
        start_s = clocks.log_start_s + BEFORE_S
        self.swing = swing
        if not self._empty:
            self.capture = self._captured(swing, motion_s, start_s)
        return Recording(log, "ok", None, start_s, start_s + motion_s, "the lab's")

    def _captured(self, swing: LabSwing, motion_s: float, start_s: float) -> dict[str, np.ndarray]:
        """Return the columns of a capture: y points up, and its origin, axes and clock are its own."""
        case, noise = self._case, TrackerNoise()
        time_s = np.arange(-FILMED_BEFORE_S, motion_s + FILMED_AFTER_S, 1.0 / FRAME_RATE_HZ)
        markers_m = points_at(swing, np.append(0.0, case.marker_places_m()), time_s)
        q = np.column_stack([np.interp(time_s, swing.time_s, joint) for joint in swing.q_rad.T])
        place_m, along, normal = np.hsplit(hand_path(case.arm.chain, q), 3)
        body_m = place_m + np.stack([along, normal, np.cross(along, normal)], axis=2) @ BODY_M
        every_m = np.concatenate([body_m[:, None], markers_m[:, 1:]], axis=1)
        seen_m = with_tracker_noise(every_m, 1.0 / FRAME_RATE_HZ, noise, self._random)
        there_m = CAPTURE_AXES.apply(seen_m.reshape(-1, 3)).reshape(seen_m.shape) + CAPTURE_ORIGIN_M
        late_s = noise.offset_s * self._random.standard_normal()
        columns = {"t": time_s + start_s - CAPTURE_CLOCK_S + late_s}
        for k in range(there_m.shape[1]):
            name, (x, y, z) = f"m{k}" if k else "hand", 1e3 * there_m[:, k].T
            columns |= {f"{name}.x": x, f"{name}.y": z, f"{name}.z": -y}
        return columns

    def true_miss_m(self, motion_s: float) -> float:
        """Return the miss of the last throw [m]."""
        assert self.swing is not None
        return true_miss(self.swing, self._case.target_m, motion_s)[0]


def play_motion(rig: SpaceRig, case: SpaceCase, motion: Path, folder: Path) -> float:
    """Play a planned motion into a trial's folder as `strandcast play` does; return its length [s]."""
    options = PlayOptions(hanging_m=case.whole_length_m())
    preflight = run_preflight(motion, case.arm, rig, folder, options)
    rig.move_to_start(preflight.motion.trajectory().q_rad[0])
    play(preflight, rig, preflight.short_hash)
    return preflight.motion.trajectory().end_s


def write_capture(rig: SpaceRig, path: Path) -> Path:
    """Write the last throw's capture as a CSV file, with empty cells where a marker was not seen."""
    rows = np.column_stack(list(rig.capture.values()))
    lines = [",".join(rig.capture)]
    lines += [",".join("" if np.isnan(x) else f"{x:.6f}" for x in row) for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def capture_options(case: SpaceCase) -> list[str]:
    """Return the options of `strandcast import track` for these captures."""
    markers = [f"{place_m:.6f}:m{k}" for k, place_m in enumerate(case.marker_places_m(), start=1)]
    given = ["--up", "y", "--length-unit", "mm", "--time-unit", "s", "--hand", "hand"]
    return [*given, *(word for marker in markers for word in ("--marker", marker))]
