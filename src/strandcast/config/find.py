"""Find the files of an experiment and its arm."""

import difflib
import os
import re
import shlex
import unicodedata
from pathlib import Path

from strandcast.config.experiment import Experiment
from strandcast.errors import StrandcastError
from strandcast.records.folders import known_experiments, parted

NO_PROJECT = "change to a project's folder, or make one: strandcast new FOLDER"
# results/paper and results/paper-quick are not experiments: they hold the summaries of many.
NAME = r"(?!paper(?:-quick)?(?:/|$))[a-z0-9][a-z0-9-]{0,63}"


SPELLED_OUT = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "ø": "oe", "æ": "ae", "å": "aa"})


def experiment_named(argument: str, root: Path) -> str:
    """Return the experiment that an argument names: by its name, or by a path to its file or in its folders.

    A path that names none is returned as it is, as is a camera's name; `find_experiment` refuses them.
    """
    experiment, camera = parted(argument)
    if not camera and os.sep not in argument and argument not in (".", ".."):
        return argument
    if camera and not Path(argument).exists() and experiment in known_experiments(root):
        return argument
    path, top = (Path(os.path.normpath(each.absolute())) for each in (Path(argument), root))
    parts = path.relative_to(top).parts if path.is_relative_to(top) else ()
    match parts:
        case ("data" | "results", name, *_):
            return name
        case ("config", "experiments", file) if file.endswith(".yaml"):
            return Path(file).stem
        case (name,) if argument.endswith(os.sep):
            return name
    return argument


def _valid_name(name: str) -> str:
    """Return the valid name that is nearest to a name."""
    plain = unicodedata.normalize("NFKD", name.lower().translate(SPELLED_OUT))
    plain = "".join(letter for letter in plain if not unicodedata.combining(letter))
    found = re.sub("[^a-z0-9]+", "-", plain).strip("-")[:64] or "string-1"
    return found if re.fullmatch(NAME, found) else f"{found}-1"


def _renaming(name: str, root: Path) -> str:
    """Return the fix for a name that is not valid: the command that renames its folder, if it is one."""
    folder = root / "data" / name
    if os.sep not in name and name.strip(".") and folder.is_dir():
        return "rename its folder: " + shlex.join(
            ["mv", str(folder), str(folder.with_name(_valid_name(name)))]
        )
    experiment, camera = parted(name)
    if camera and experiment in known_experiments(root):
        return f"give the experiment's name without a camera's: {experiment}"
    taken = "; `paper` and `paper-quick` are taken" if name.startswith("paper") else ""
    return f"use up to 64 lower-case letters, digits and hyphens, e.g. `string-1`{taken}"


def find_experiment(name: str, root: Path) -> Path:
    """Return the file of an experiment: data/<name>/experiment.yaml, or config/experiments/<name>.yaml."""
    if not re.fullmatch(NAME, name):
        raise StrandcastError(
            "SC-R032",
            f"{name!r} is not a valid name of an experiment",
            fix=_renaming(name, root),
        )
    own, shipped = root / "data" / name / "experiment.yaml", root / "config" / "experiments" / f"{name}.yaml"
    for path in (own, shipped):
        if path.is_file():
            return path
    known = [each for each in known_experiments(root) if each != name]
    misspelt = _misspelt(own)
    near = difflib.get_close_matches(name, known, n=1)
    fix = f"known: {', '.join(known)}" if known else NO_PROJECT
    fix = f"did you mean {near[0]!r}?" if near else fix
    if misspelt is not None:
        fix = "rename its file: " + shlex.join(["mv", str(misspelt), str(own)])
    raise StrandcastError("SC-F001", f"there is no experiment {name!r}", file=own, fix=fix)


def overlooked_experiments(root: Path) -> list[StrandcastError]:
    """Return a problem for each folder under data/ that holds trials or settings, but is no experiment."""
    shipped = {path.stem for path in root.glob("config/experiments/*.yaml")}
    found = []
    for folder in sorted(path for path in root.glob("data/*") if path.is_dir() and path.name not in shipped):
        file = folder / "experiment.yaml"
        trials = [
            path for path in folder.iterdir() if path.is_dir() and path.name.lower().startswith("trial")
        ]
        misspelt = _misspelt(file)
        if file.is_file() or not (trials or misspelt):
            continue
        fix = "write it; config/experiments/demo.yaml is a commented example"
        if misspelt is not None:
            fix = "rename it: " + shlex.join(["mv", str(misspelt), str(file)])
        what = "the folder has no experiment.yaml, so that it is no experiment"
        found.append(StrandcastError("SC-F001", what, file=folder, fix=fix))
    return found


def _misspelt(file: Path) -> Path | None:
    """Return the one settings file of another spelling in a folder: experiment.yml, Experiment.yaml."""
    there = file.parent.iterdir() if file.parent.is_dir() else ()
    names = ("experiment.yml", "experiment.yaml")
    return next((path for path in there if path.name.lower() in names and path != file), None)


def named_arm(name: Path, root: Path) -> Path:
    """Return the arm's file of a command line: a path, or the name of an arm in config/arms."""
    known = root / "config" / "arms" / f"{name}.toml"
    return known if not name.is_file() and known.is_file() else name


def find_arm(experiment: Experiment, experiment_file: Path, root: Path) -> Path:
    """Return the arm's file: a name in config/arms, or a path relative to the experiment's file.

    Raises
    ------
    StrandcastError
        SC-F001 there is no such arm; SC-F010 the file lies outside both folders.
    """
    folders = root / "config" / "arms", experiment_file.parent
    for folder, name in zip(folders, (f"{experiment.arm}.toml", experiment.arm), strict=True):
        path = folder / name
        if path.is_file():
            real = path.resolve()
            if any(real.is_relative_to(within.resolve()) for within in folders):
                return path
            raise StrandcastError(
                "SC-F010",
                f"{real} lies outside {' and '.join(map(str, folders))}",
                file=experiment_file,
                field="arm",
                fix="copy the arm's file and its URDF into one of these folders",
            )
    known = sorted(p.stem for p in root.glob("config/arms/*.toml"))
    what = f"there is no arm {experiment.arm!r}"
    fix = f"one of {', '.join(known)}, or the path of an arm's file"
    raise StrandcastError("SC-F001", what, file=experiment_file, field="arm", fix=fix)
