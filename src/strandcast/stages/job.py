"""A stage's declaration, and the files of one run of it, by role."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from strandcast.core.trial_names import trial_digits, trial_name
from strandcast.records.folders import TrialFolder
from strandcast.stages.context import Context


@dataclass(frozen=True)
class Job:
    """One run of a stage: an experiment and one of its trials, or all its trials."""

    context: Context
    trial: int = 0
    trials: tuple[int, ...] = ()

    @property
    def folder(self) -> TrialFolder:
        """Return the folders of the trial."""
        return self.context.folder.trial(self.trial)

    @property
    def is_lab(self) -> bool:
        """Return whether the lab throws this experiment: its raw files can be named before they exist."""
        return self.context.settings.lab is not None


Role = Callable[[Job], list[Path]]
Pattern = str | list[str]


@dataclass(frozen=True)
class Stage:
    """The declaration of one stage.

    Attributes
    ----------
    inputs
        Role -> the files that must exist; a change of one of them makes the stage run again.
    outputs
        Role -> path, or paths, with the fields ``{experiment}``, ``{trial}`` and ``{camera}``.
    settings
        The parts of experiment.yaml that the stage reads.
    without_motion
        Those that it reads only of a trial whose motion is not there: a new target changes nothing of a throw
        that aimed at another.
    may_read
        Role -> files that the stage reads too, without a dependency of their own: raw files whose hash an
        input records, and results that are shown if they exist.
    hashed_by_stage
        Roles of inputs whose hashes are part of an output's content; the lineage does not repeat them.
    """

    name: str
    inputs: Mapping[str, Role]
    outputs: Mapping[str, Pattern]
    settings: tuple[str, ...] = ()
    without_motion: tuple[str, ...] = ()
    may_read: Mapping[str, Role] = field(default_factory=dict)
    hashed_by_stage: tuple[str, ...] = ()

    def lineage_roles(self) -> list[str]:
        """Return the roles of the inputs whose hashes the lineage of the outputs holds."""
        return [role for role in self.inputs if role not in self.hashed_by_stage]

    def output_files(self, job: Job) -> dict[str, list[Path]]:
        """Return the output files of a job by role, those of every camera."""
        context, trial = job.context, trial_digits(job.trial)
        found = {}
        for role, patterns in self.outputs.items():
            paths = [
                context.folder.root / pattern.format(experiment=context.name, trial=trial, camera=camera)
                for pattern in ([patterns] if isinstance(patterns, str) else patterns)
                for camera in context.settings.cameras
            ]
            found[role] = list(dict.fromkeys(paths))
        return found


@dataclass(frozen=True)
class Files:
    """The files of one job, as its stage declares them; a role that is not declared is a `KeyError`."""

    stage: Stage
    job: Job

    def inputs(self, role: str, trial: int | None = None) -> list[Path]:
        """Return the files to read in a role: all, or those of one trial."""
        paths = {**self.stage.inputs, **self.stage.may_read}[role](self.job)
        return [path for path in paths if trial is None or path.parent.name == trial_name(trial)]

    def input(self, role: str, trial: int | None = None) -> Path:
        """Return the file to read in a role; if there are several, the first."""
        return self.inputs(role, trial)[0]

    def optional(self, role: str, trial: int | None = None) -> Path | None:
        """Return the file to read in a role if it exists, else None."""
        return next((path for path in self.inputs(role, trial) if path.is_file()), None)

    def all_inputs(self) -> list[Path]:
        """Return the input files of all roles."""
        return [path for find in self.stage.inputs.values() for path in find(self.job)]

    def all_outputs(self) -> list[Path]:
        """Return the output files of all roles."""
        return [path for paths in self.stage.output_files(self.job).values() for path in paths]

    def output(self, role: str) -> Path:
        """Return the file to write in a role; if there are several, the first."""
        return self.stage.output_files(self.job)[role][0]

    @property
    def log(self) -> Path:
        """Return the file to which a run of the workflow writes what the job prints."""
        context, trial = self.job.context, self.job.trial
        folder = self.job.folder.results if trial else context.folder.results
        if self.stage.name == "calibrate":
            folder = context.folder.camera(context.settings.camera_name).with_suffix("")
        return folder / "logs" / f"{self.stage.name}.log"

    @property
    def usage(self) -> Path:
        """Return the file that holds the job's time and memory, of a run of the workflow."""
        return self.log.with_suffix(".jsonl")
