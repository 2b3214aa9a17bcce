"""What every stage begins with: the experiment's settings and its folders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.experiment import Experiment, find_arm, find_experiment, load_experiment
from strandcast.layout import ExperimentFolder


@dataclass(frozen=True)
class Context:
    """One experiment: its name, settings, the file that they come from, its folders."""

    name: str
    settings: Experiment
    file: Path
    folder: ExperimentFolder

    @property
    def arm_file(self) -> Path:
        """Return the arm's file."""
        return find_arm(self.settings, self.file, self.folder.root)

    def counted_before(self, trial: int) -> list[int]:
        """Return the trials before this one that are not excluded."""
        return [number for number in range(1, trial) if self.settings.excluded_reason(number) is None]


def context_of(root: Path, name: str) -> Context:
    """Find and read an experiment."""
    file = find_experiment(name, root)
    return Context(name, load_experiment(file), file, ExperimentFolder(root, name))


def refuse_replacing(path: Path, replace: bool) -> None:
    """Refuse to write over what was imported before, unless that is wanted."""
    if path.is_file() and not replace:
        raise StrandcastError(
            "SC-I022", "has been imported already", file=path, fix="import as another trial, or add --replace"
        )


def free_length_m(context: Context, swallowed_m: float) -> float:
    """Return the length of the string beyond the clamp [m]."""
    return context.settings.string.length_m - swallowed_m
