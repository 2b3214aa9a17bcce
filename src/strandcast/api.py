"""The Python interface: experiments, trials and fitted strings, as pandas tables and records.

Use it by `strandcast.open`. It reads files and calls the functions that the stages call; it writes nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from pydantic import ValidationError
from threadpoolctl import threadpool_limits

from strandcast.arm.load import Arm, load_arm
from strandcast.config.experiment import Experiment
from strandcast.dynamics.physical import simulate
from strandcast.errors import StrandcastError
from strandcast.film.result import FilmTrack
from strandcast.film.track import track_film
from strandcast.planning.rollouts import RolloutConditions, commands, simulate_rollouts
from strandcast.records.alignment import Alignment
from strandcast.records.estimate import Estimate
from strandcast.records.folders import TrialFolder, known_experiments
from strandcast.records.load import load
from strandcast.records.motion import Motion
from strandcast.records.record import Record
from strandcast.records.summary import ExperimentSummary
from strandcast.records.track import AXES
from strandcast.records.verdict import Verdict
from strandcast.stages import plan, score
from strandcast.stages.context import Context, context_named
from strandcast.stages.declarations import STAGES
from strandcast.stages.job import Files, Job
from strandcast.stages.plan_inputs import next_inputs, servo_of

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ExperimentView", "FilmTrack", "FittedString", "Project", "TrialView", "simulate", "track_film"]
SIMULATED_UNITS = {"member": "1", "time_s": "s", "point": "1"} | dict.fromkeys(AXES, "m")


class Project:
    """The experiments of a project, by name: ``project["demo"]``, ``list(project)``.

    Raises
    ------
    StrandcastError
        SC-W001 the folder holds none of data/, results/ and config/; SC-F001 there is no such experiment.
    """

    def __init__(self, root: str | Path) -> None:
        root = Path(root)
        if not any((root / name).is_dir() for name in ("data", "results", "config")):
            what = "is no project: it holds none of data/, results/ and config/"
            raise StrandcastError("SC-W001", what, file=root, fix="give the folder that holds data/")
        self.root = root

    def __getitem__(self, name: str) -> ExperimentView:
        return ExperimentView(context_named(self.root, name))

    def __iter__(self) -> Iterator[str]:
        return iter(known_experiments(self.root))

    def __repr__(self) -> str:
        return f"Project({str(self.root)!r}: {', '.join(self) or 'no experiments'})"


class Trials(dict[int, "TrialView"]):
    """The trials of an experiment by number."""

    def __missing__(self, number: int) -> TrialView:
        numbers = ", ".join(map(str, self)) or "none"
        raise KeyError(f"there is no trial {number}; there are files of: {numbers}")


@dataclass(frozen=True)
class ExperimentView:
    """One experiment: its settings, its arm, its trials."""

    context: Context

    @property
    def name(self) -> str:
        """The experiment's name."""
        return self.context.name

    @property
    def settings(self) -> Experiment:
        """All settings of experiment.yaml, defaults included."""
        return self.context.settings

    @property
    def arm(self) -> Arm:
        """The arm: limits, kinematics (`arm.chain`), clamp, servo."""
        return load_arm(self.context.arm_file)

    @property
    def trials(self) -> Trials:
        """The trials that have files, by number, counted from 1."""
        return Trials({k: TrialView(self.context, k) for k in self.context.folder.all_trials()})

    @property
    def table(self) -> pd.DataFrame:
        """The trials of the last run as rows: miss, fit, clocks, the rig's health; units are in the names."""
        import pandas as pd

        summary = ExperimentSummary.read(self.context.folder.results / "summary.json")
        return pd.DataFrame([trial.model_dump() for trial in summary.trials])

    def trial(self, number: int) -> TrialView:
        """Return one trial, whether it has files or not: what is not there is refused when it is read."""
        return TrialView(self.context, number)

    def __repr__(self) -> str:
        return f"ExperimentView({self.name!r}: {len(self.trials)} trials)"


@dataclass(frozen=True)
class TrialView:
    """One trial. Tables carry the units of their columns in ``attrs["units"]``; a missing file is SC-R001."""

    context: Context
    number: int

    @property
    def folder(self) -> TrialFolder:
        """The trial's folders, ``data`` and ``results``."""
        return self.context.folder.trial(self.number)

    @property
    def track(self) -> pd.DataFrame:
        """The mass points and their standard errors [m], on the camera's clock; a row per frame and point.

        Its column ``flags`` is ``track["flags"]``: ``track.flags`` is pandas' own attribute.
        """
        return self._table("track.parquet")

    @property
    def observations(self) -> pd.DataFrame:
        """The detections in pixels."""
        return self._table("observations.parquet")

    @property
    def hand(self) -> pd.DataFrame:
        """The hand's path on the robot's clock, by `source` of the joints."""
        return self._table("hand.parquet")

    @property
    def simulated(self) -> pd.DataFrame:
        """The string as planned and as fitted, in the track's frames, on the robot's clock."""
        return self._table("simulated.parquet")

    @property
    def joints(self) -> pd.DataFrame:
        """The robot's log."""
        return cast("pd.DataFrame", load(self.folder.data / "joints.csv"))

    @property
    def alignment(self) -> Alignment:
        """The clocks: ``alignment.robot_time_s(track["camera_time_s"])``."""
        return Alignment.read(self.folder.results / "alignment.json")

    @property
    def motion(self) -> Motion:
        """The motion that was planned, or played."""
        return Motion.read(self.folder.results / "motion.json")

    @property
    def verdict(self) -> Verdict:
        """By how much the throw missed the experiment's target, as the stage `score` wrote it."""
        return Verdict.read(self.folder.results / "verdict.json")

    @property
    def estimate(self) -> FittedString:
        """The string that was fitted to the trials up to this one."""
        return FittedString(self.context, self.number)

    def score(self, **settings: Any) -> Verdict:
        """Return by how much the throw missed, or would have missed with other settings.

        Parameters
        ----------
        settings
            Settings of experiment.yaml that replace its own: ``target_m=(0.6, 0.4)``, ``hit_radius_m=0.03``.
        """
        return score.verdict_of(*_job(self.context, "score", self.number, settings))

    def record(self, name: str) -> Record:
        """Return another record of the trial by its file's name, e.g. ``manifest.json``, ``track.json``."""
        return cast(Record, load(self.folder.results / name))

    def _table(self, name: str) -> pd.DataFrame:
        return cast("pd.DataFrame", load(self.folder.results / name))

    def __repr__(self) -> str:
        return f"TrialView({self.context.name!r}, {self.number})"


@dataclass(frozen=True)
class FittedString:
    """The string fitted after one trial."""

    context: Context
    trial: int

    @property
    def record(self) -> Estimate:
        """The estimate: parameters, masses, E and its uncertainty."""
        return Estimate.read(self._file("estimate.json"))

    @property
    def ensemble(self) -> pd.DataFrame:
        """The near-best strings, the best first: a row per string."""
        return cast("pd.DataFrame", load(self._file("ensemble.parquet")))

    def simulate(self, motion: Motion | str | Path, members: int = 1) -> pd.DataFrame:
        """Return the string's path during a motion, from rest, with the servos' response in estimate.json.

        The planner describes joints that yield to the arm's torques better (`arm.yielding_joints`).

        Parameters
        ----------
        motion
            A motion of the experiment's arm, or its file.
        members
            How many strings of the ensemble to simulate, the best first.

        Returns
        -------
        pandas.DataFrame
            Columns member, time_s (since the motion's start, until 0.3 s after its end) [s], point (0: the
            hand), x_m, y_m, in space z_m [m]; NaN from where a simulation diverged.

        Raises
        ------
        StrandcastError
            SC-X004 the motion is of other joints than the arm's; otherwise as the readers of files.
        """
        import pandas as pd

        played = motion if isinstance(motion, Motion) else Motion.read(motion)
        arm = load_arm(self.context.arm_file)
        if tuple(played.joint_names) != arm.joints:
            what = f"are {played.joint_names}, the arm's are {list(arm.joints)}"
            raise StrandcastError("SC-X004", what, field="joint_names")
        task, fitted = next_inputs(self.context, arm, self._file("ensemble.parquet"))
        strings = fitted.first(members)
        trajectory = played.trajectory().resampled(task.step_s)
        time_s, q_rad, last = commands([trajectory], task.step_s)
        conditions = RolloutConditions(servo_of(self.record.servo))
        q_rad = conditions.followed(q_rad, task.step_s)
        points_m = simulate_rollouts(task, strings, conditions, q_rad, last).points_m
        member, sample, point = (index.ravel() for index in np.indices(points_m.shape[:3]))
        columns = (member, time_s[sample], point, *points_m.reshape(-1, points_m.shape[-1]).T)
        frame = pd.DataFrame(dict(zip(SIMULATED_UNITS, columns, strict=False)))
        frame.attrs = {"units": dict(list(SIMULATED_UNITS.items())[: len(columns)])}
        return frame

    def plan(self, **settings: Any) -> Motion:
        """Return the next motion, from all trials so far; excluded trials are left out.

        Parameters
        ----------
        settings
            Settings of experiment.yaml that replace its own, e.g. ``target_m=(0.6, 0.4)``.
        """
        with threadpool_limits(1):  # as the stages: the last digits must not depend on the number of cores
            return plan.plan_motion(*_job(self.context, "plan", self.trial + 1, settings))[0]

    def _file(self, name: str) -> Path:
        return self.context.folder.trial(self.trial).results / name

    def __repr__(self) -> str:
        return f"FittedString({self.context.name!r}, after trial {self.trial})"


def _job(context: Context, stage: str, trial: int, settings: dict[str, Any]) -> tuple[Job, Files]:
    """Return the job of a stage with some settings replaced, which are validated as those of a file."""
    if settings:
        try:
            changed = Experiment.model_validate(context.settings.model_dump() | settings)
        except ValidationError as error:
            first = error.errors()[0]
            field = ".".join(map(str, first["loc"])) or ", ".join(settings)
            raise StrandcastError("SC-F003", first["msg"], file=context.file, field=field) from None
        context = replace(context, settings=changed)
    job = Job(context, trial)
    return job, Files(STAGES[stage], job)
