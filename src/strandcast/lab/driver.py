"""The player's driver of the virtual arm; playing, it also films, as the camera in a lab does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.arm.load import Arm
from strandcast.experiment import Experiment, find_experiment, load_experiment
from strandcast.lab.film import actors_of, frames
from strandcast.lab.led import Switched, switched
from strandcast.lab.scene import Scene, make_scene
from strandcast.lab.strings import thread_of
from strandcast.lab.swing import BEFORE_S, CYCLE_S, Swing, simulate_swing
from strandcast.lab.truth import write_truth
from strandcast.lab.variation import Clocks, Variation, draw_clocks, draw_variation
from strandcast.lab.video import write_video
from strandcast.layout import ExperimentFolder
from strandcast.player.protocol import Command, Recording, State
from strandcast.progress import progress
from strandcast.records.joint_log import SYNC_HIGH, JointLog, SyncEvent
from strandcast.records.motion import Motion
from strandcast.seeds import rng

VIDEO = "video.mp4"
FILMED_AFTER_S = 0.45
ENCODER_STEPS = 65536  # a turn
SPEED_DIGITS = 4


@dataclass(frozen=True)
class Throw:
    """Which throw of which experiment, and where its truth is to be written."""

    name: str
    experiment: Experiment
    trial: int
    truth_path: Path


def lab_driver(arm: Arm, motion: Motion) -> LabDriver:
    """Return the virtual rig of the experiment and trial that a motion is for (see `player.drivers`)."""
    root = Path()
    experiment = load_experiment(find_experiment(motion.experiment, root))
    truth = ExperimentFolder(root, motion.experiment).trial(motion.trial).results / "lab_truth.parquet"
    return LabDriver(Throw(motion.experiment, experiment, motion.trial, truth), arm)


class LabDriver:
    """The virtual rig of one throw (see `strandcast.player.protocol.Driver`)."""

    name = "lab"
    streams = False
    address: str | None = None

    def __init__(self, throw: Throw, arm: Arm, scene: Scene | None = None) -> None:
        self.rate_hz = arm.log_rate_hz
        self._throw = throw
        self._arm = arm
        self._scene = scene
        self._q_rad = np.array(arm.limits.lower_rad + arm.limits.upper_rad) / 2

    def connect(self) -> None:
        """Check that the experiment has a virtual rig."""
        thread_of(self._throw.experiment)

    def state(self) -> State:
        """Return the arm at rest where it was last moved to."""
        return State(self._q_rad.copy(), np.zeros_like(self._q_rad))

    def move_to_start(self, q_rad: np.ndarray) -> None:
        """Stand at (J,) angles."""
        self._q_rad = np.array(q_rad, float)

    def stop(self) -> None:
        """Do nothing: the virtual arm rests between throws."""

    def play(self, command: Command, folder: Path) -> Recording:
        """Throw, film, write the truth; the log is what the controller says."""
        throw, arm, experiment = self._throw, self._arm, self._throw.experiment
        assert experiment.lab is not None
        variation = draw_variation(self._random("lab-throw"), len(arm.joints), experiment.lab.noise)
        clocks = draw_clocks(self._random("lab-clocks"))
        thread = thread_of(experiment)
        swing = simulate_swing(arm, experiment.lab.servo, thread, variation, command)
        scene = self._scene or make_scene(experiment, throw.name, arm)
        actors = actors_of(swing, thread.shifted(variation.grasp_length_m))
        start_s, motion_s = clocks.log_start_s + BEFORE_S, float(command.time_s[-1])
        lamp = switched(motion_s, self._random("lab-led")) if experiment.lab.led else None
        camera = experiment.lab.camera
        count = int((clocks.camera_lead_s + motion_s + FILMED_AFTER_S) * camera.frame_rate_hz)
        camera_time_s = np.arange(count) / camera.frame_rate_hz
        robot_time_s = camera_time_s * (1.0 + clocks.drift) + start_s - clocks.camera_lead_s
        shots = frames(scene, actors, robot_time_s - start_s, camera.exposure_s, camera.noise_grey,
                       self._random("lab-sensor"), lamp)  # fmt: skip
        shown = progress(shots, "film", total=count)
        write_video(folder / VIDEO, shown, camera.width_px, camera.height_px, camera.frame_rate_hz)
        write_truth(throw.truth_path, scene, swing, variation, clocks, robot_time_s, start_s, motion_s,
                    np.array(experiment.target_m))  # fmt: skip
        log = joint_log(arm, swing, variation, clocks, motion_s, self._random("lab-log"))
        return Recording(
            log=log,
            status="ok",
            reason=None,
            motion_start_s=start_s,
            motion_end_s=start_s + motion_s,
            clock="virtual controller",
            controller={"model": f"{arm.name} (virtual)", "servo": experiment.lab.servo},
            sync_events=[] if lamp is None else _switch_output(log, lamp, start_s),
            video={"file": VIDEO},
        )

    def _random(self, what: str) -> np.random.Generator:
        return rng(self._throw.name, self._throw.experiment.seed, self._throw.trial, what)


def _switch_output(log: JointLog, lamp: Switched, start_s: float) -> list[SyncEvent]:
    """Set the log's sync output as the LED was switched, and return these events."""
    events = [
        SyncEvent(kind=kind, time_s=round(start_s + since_s, 6))
        for kind, since_s in (("led_on", lamp.on_s), ("led_off", lamp.off_s))
    ]
    on, off = (np.searchsorted(log.time_s, event.time_s - 1e-9) for event in events)
    log.flags[on:off] |= SYNC_HIGH
    return events


def joint_log(
    arm: Arm, swing: Swing, variation: Variation, clocks: Clocks, motion_s: float, random: np.random.Generator
) -> JointLog:
    """Return what the controller logs: encoders with zero error, noise and steps; commands as received."""
    every = round(1.0 / (arm.log_rate_hz * CYCLE_S))
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
