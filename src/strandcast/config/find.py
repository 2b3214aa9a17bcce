"""Find the files of an experiment and its arm."""

import difflib
import re
from pathlib import Path

from strandcast.config.experiment import Experiment
from strandcast.errors import StrandcastError

NAME = r"[a-z0-9][a-z0-9-]{0,63}"


def find_experiment(name: str, root: Path) -> Path:
    """Return the file of an experiment: data/<name>/experiment.yaml, or config/experiments/<name>.yaml."""
    if not re.fullmatch(NAME, name):
        raise StrandcastError(
            "SC-F005",
            f"{name!r} is not a valid name of an experiment",
            fix="use up to 64 lower-case letters, digits and hyphens, e.g. `string-1`",
        )
    own, shipped = root / "data" / name / "experiment.yaml", root / "config" / "experiments" / f"{name}.yaml"
    for path in (own, shipped):
        if path.is_file():
            return path
    known = sorted(
        {p.parent.name for p in root.glob("data/*/experiment.yaml")}
        | {p.stem for p in root.glob("config/experiments/*.yaml")}
    )
    near = difflib.get_close_matches(name, known, n=1)
    raise StrandcastError(
        "SC-F001",
        f"there is no experiment {name!r}",
        file=own,
        fix=f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known) or 'none'}",
    )


def find_arm(experiment: Experiment, experiment_file: Path, root: Path) -> Path:
    """Return the arm's file: a name in config/arms, or a path relative to the experiment's file.

    Raises
    ------
    StrandcastError
        SC-F004 there is no such arm; SC-F010 the file lies outside both folders.
    """
    folders = root / "config" / "arms", experiment_file.parent
    for folder, name in zip(folders, (f"{experiment.arm}.toml", experiment.arm), strict=True):
        path = folder / name
        if path.is_file():
            return _within(folders, path, experiment_file)
    known = sorted(p.stem for p in root.glob("config/arms/*.toml"))
    raise StrandcastError(
        "SC-F004",
        f"there is no arm {experiment.arm!r}",
        file=experiment_file,
        field="arm",
        fix=f"one of {', '.join(known)}, or the path of an arm's file",
    )


def _within(folders: tuple[Path, ...], path: Path, experiment_file: Path) -> Path:
    real = path.resolve()
    if any(real.is_relative_to(folder.resolve()) for folder in folders):
        return path
    raise StrandcastError(
        "SC-F010",
        f"{real} lies outside {' and '.join(map(str, folders))}",
        file=experiment_file,
        field="arm",
        fix="copy the arm's file and its URDF into one of these folders",
    )
