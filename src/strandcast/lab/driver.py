"""The drivers of the virtual arm: one films the throw, one captures it in space, one plays a rehearsal."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.arm.load import Arm
from strandcast.config.experiment import Experiment
from strandcast.config.find import find_experiment
from strandcast.config.lab import LabSettings
from strandcast.config.load import load_experiment
from strandcast.core.trajectory import JointTrajectory
from strandcast.executor.drivers.protocol import ArmState, Driver, Recording
from strandcast.lab.capture import (
    CAPTURE,
    CAPTURE_RATE_HZ,
    captured,
    draw_capture_rig,
    marker_places_m,
    write_capture,
)
from strandcast.lab.film import film_frames, film_subject
from strandcast.lab.led import LedTimes, led_times
from strandcast.lab.rig import SlipInClamp
from strandcast.lab.scene import LabScene, make_scene
from strandcast.lab.servo import CYCLE_S
from strandcast.lab.strings import EMPTY_CLAMP, PhysicalString, physical_string
from strandcast.lab.swing import BEFORE_S, LabSwing, simulate_swing
from strandcast.lab.swing_in_space import VariationInSpace, simulate_swing_in_space
from strandcast.lab.truth import RecordedThrow, film_facts, write_truth
from strandcast.lab.variation import LabClocks, ThrowVariation, draw_clocks, draw_variation, scatter_of
from strandcast.lab.video import write_video
from strandcast.progress import progress
from strandcast.records.folders import ExperimentFolder, project_root
from strandcast.records.joint_log import SYNC_HIGH, JointLog, SyncEvent
from strandcast.records.motion import Motion
from strandcast.seeds import rng

VIDEO = "video.mp4"
# Chosen.
FILMED_AFTER_S = 0.45
ENCODER_STEPS = 65536  # per turn
SPEED_DIGITS = 4


@dataclass(frozen=True)
class LabThrow:
    """A throw of an experiment, the file for its truth where it is recorded, and a slip in the clamp."""

    name: str
    experiment: Experiment
    trial: int
    truth_path: Path | None = None
    slip: SlipInClamp | None = None


def lab_driver(arm: Arm, motion: Motion) -> Driver:
    """Return the virtual rig of a motion's experiment (see `strandcast.executor.drivers.registry`)."""
    root = project_root()
    experiment = load_experiment(find_experiment(motion.experiment, root))
    truth = ExperimentFolder(root, motion.experiment).trial(motion.trial).results / "lab_truth.parquet"
    return driver_of(LabThrow(motion.experiment, experiment, motion.trial, truth), arm)


def driver_of(throw: LabThrow, arm: Arm) -> Driver:
    """Return the virtual rig of a throw: with a camera, or in space with motion capture."""
    return LabDriverInSpace(throw, arm) if arm.axes == 3 else LabDriver(throw, arm)


class LabArm:
    """The virtual arm of one throw: what all its drivers share."""

    name = "lab"
    streams = False
    address: str | None = None

    def __init__(self, throw: LabThrow, arm: Arm) -> None:
        self.rate_hz = arm.log_rate_hz
        self._throw = throw
        self._arm = arm
        self._q_rad = np.array(arm.limits.lower_rad + arm.limits.upper_rad) / 2

    def connect(self) -> None:
        """Check that the experiment has a virtual rig."""
        physical_string(self._throw.experiment)

    def state(self) -> ArmState:
        """Return the arm at rest at its last posture."""
        return ArmState(self._q_rad.copy(), np.zeros_like(self._q_rad))

    def move_to_start(self, q_rad: np.ndarray) -> None:
        """Set the posture to (J,) angles."""
        self._q_rad = np.array(q_rad, float)

    def stop(self) -> None:
        """Do nothing: the virtual arm is at rest between throws."""

    @property
    def _lab(self) -> LabSettings:
        assert self._throw.experiment.lab is not None
        return self._throw.experiment.lab

    def _string(self) -> PhysicalString:
        return physical_string(self._throw.experiment).clamped(self._arm.clamp.clamped_length_m)

    def _variation(self) -> VariationInSpace:
        """Draw the throw's deviations; in the plane, those along the first direction count."""
        lab, random = self._lab, self._random("lab-throw")
        scatter = scatter_of(self._throw.name, self._throw.experiment.seed, lab)
        return VariationInSpace(
            *(draw_variation(random, len(self._arm.joints), 1.0, scatter) for _ in range(2))
        )

    def _swing(
        self, string: PhysicalString, variation: VariationInSpace, command: JointTrajectory
    ) -> LabSwing:
        arm, servo, throw = self._arm, self._lab.servo, self._throw
        if arm.axes == 2:
            return simulate_swing(arm.planar(), servo, string, variation.along, command, slip=throw.slip)
        curl_turn_rad = float(self._rig_random("lab-curl").uniform(0.0, 2.0 * np.pi))
        return simulate_swing_in_space(arm.spatial(), servo, string, curl_turn_rad, variation, command)

    def _recorded(
        self, swing: LabSwing, variation: ThrowVariation, clocks: LabClocks, motion_s: float
    ) -> Recording:
        start_s = clocks.log_start_s + BEFORE_S
        return Recording(
            log=joint_log(self._arm, swing, variation, clocks, motion_s, self._random("lab-log")),
            status="ok",
            reason=None,
            motion_start_s=start_s,
            motion_end_s=start_s + motion_s,
            clock="virtual controller",
            controller={"model": f"{self._arm.name} (virtual)", "servo": self._lab.servo},
        )

    def _write_truth(self, recorded: RecordedThrow, more: dict[str, Any]) -> None:
        throw = self._throw
        assert throw.truth_path is not None
        write_truth(throw.truth_path, recorded, np.array(throw.experiment.target_m), more)

    def _random(self, what: str) -> np.random.Generator:
        return rng(self._throw.name, self._throw.experiment.seed, self._throw.trial, what)

    def _rig_random(self, what: str) -> np.random.Generator:
        """Return the random numbers of what is the same in all throws."""
        return rng(self._throw.name, self._throw.experiment.seed, 0, what)


class LabDriver(LabArm):
    """The virtual rig of one throw in the plane (see `strandcast.executor.drivers.protocol.Driver`)."""

    def __init__(self, throw: LabThrow, arm: Arm, scene: LabScene | None = None) -> None:
        super().__init__(throw, arm)
        self._scene = scene

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        """Throw, film and write the truth; return the controller's log."""
        throw, experiment, lab, arm = self._throw, self._throw.experiment, self._lab, self._arm.planar()
        variation, clocks = self._variation(), draw_clocks(self._random("lab-clocks"))
        string = self._string()
        swing = self._swing(string, variation, command)
        scene = self._scene or make_scene(experiment, throw.name, arm)
        actors = film_subject(swing, string.shifted(variation.along.grasp_length_m))
        start_s, motion_s = clocks.log_start_s + BEFORE_S, float(command.time_s[-1])
        lamp = led_times(motion_s, self._random("lab-led")) if scene.led is not None else None
        camera = lab.camera
        robot_time_s = frame_times_s(clocks, motion_s, camera.frame_rate_hz)
        since_s, random = robot_time_s - start_s, self._random("lab-sensor")
        shots = film_frames(scene, actors, since_s, camera.exposure_s, camera.noise_grey, random, lamp)
        shown = progress(shots, "film", total=len(since_s))
        write_video(folder / VIDEO, shown, *camera.size_px, camera.frame_rate_hz)
        filmed = RecordedThrow(swing, asdict(variation.along), clocks, robot_time_s, start_s, motion_s)
        self._write_truth(filmed, film_facts(scene, filmed))
        recording = self._recorded(swing, variation.along, clocks, motion_s)
        events = [] if lamp is None else _switch_output(recording.log, lamp, start_s)
        return replace(recording, sync_events=events, video={"file": VIDEO})


class LabDriverInSpace(LabArm):
    """The virtual rig of one throw in space: motion capture of markers on the string and on the hand."""

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        """Throw, capture and write the truth; return the controller's log."""
        variation, clocks = self._variation(), draw_clocks(self._random("lab-clocks"))
        string = self._string()
        swing = self._swing(string, variation, command)
        start_s, motion_s = clocks.log_start_s + BEFORE_S, command.end_s
        robot_time_s = frame_times_s(clocks, motion_s, CAPTURE_RATE_HZ)
        rig = draw_capture_rig(self._rig_random("lab-capture"))
        places_m = marker_places_m(string.length_m) + variation.along.grasp_length_m
        since_s, random = robot_time_s - start_s, self._random("lab-sensor")
        write_capture(folder / CAPTURE, captured(rig, self._arm.spatial(), swing, places_m, since_s, random))
        recorded = RecordedThrow(swing, variation.facts(), clocks, robot_time_s, start_s, motion_s)
        self._write_truth(recorded, rig.facts())
        return self._recorded(swing, variation.along, clocks, motion_s)


class LabRehearsal(LabArm):
    """The virtual arm with an empty clamp; nothing is recorded but the joints."""

    def play(self, command: JointTrajectory, folder: Path) -> Recording:
        """Play the motion; return the controller's log."""
        along, across = self._variation()
        along = replace(along, grasp_length_m=0.0)
        swing = self._swing(EMPTY_CLAMP, VariationInSpace(along, across), command)
        clocks = draw_clocks(self._random("lab-clocks"))
        return self._recorded(swing, along, clocks, float(command.time_s[-1]))


def frame_times_s(clocks: LabClocks, motion_s: float, rate_hz: float) -> np.ndarray:
    """Return the robot's times (F,) of the frames of a throw, from before the motion to after it."""
    count = int((clocks.camera_lead_s + motion_s + FILMED_AFTER_S) * rate_hz)
    start_s = clocks.log_start_s + BEFORE_S
    return np.arange(count) / rate_hz * (1.0 + clocks.drift) + start_s - clocks.camera_lead_s


def _switch_output(log: JointLog, lamp: LedTimes, start_s: float) -> list[SyncEvent]:
    """Mark the LED's switching in the log's sync output; return its events."""
    events = [
        SyncEvent(kind=kind, time_s=round(start_s + since_s, 6))
        for kind, since_s in (("led_on", lamp.on_s), ("led_off", lamp.off_s))
    ]
    on, off = (np.searchsorted(log.time_s, event.time_s - 1e-9) for event in events)
    log.flags[on:off] |= SYNC_HIGH
    return events


def joint_log(
    arm: Arm,
    swing: LabSwing,
    variation: ThrowVariation,
    clocks: LabClocks,
    motion_s: float,
    random: np.random.Generator,
) -> JointLog:
    """Return the controller's log: encoders with zero error, noise and steps; commands as received."""
    every = max(1, round(1.0 / (arm.log_rate_hz * CYCLE_S)))
    rows = slice(0, None, every)
    since_s = swing.time_s[rows]
    q = swing.q_rad[rows] - variation.joint_zero_rad
    q = q + variation.log_noise_rad * random.standard_normal(q.shape)
    step = 2.0 * np.pi / ENCODER_STEPS
    in_motion = (since_s >= -1e-9) & (since_s <= motion_s + 1e-9)
    return JointLog(
        joint_names=list(arm.joints),
        time_s=np.round(since_s + clocks.log_start_s + BEFORE_S, 6),
        q_rad=np.round(np.round(q / step) * step, 7),
        qd_rad_s=np.round(swing.qd_rad_s[rows], SPEED_DIGITS),
        q_cmd_rad=swing.command_rad[rows],
        qd_cmd_rad_s=swing.command_rad_s[rows],
        since_start_s=np.where(in_motion, np.round(since_s, 6), np.nan),
        flags=np.zeros(len(since_s), np.int32),
    )
