"""The workflow and the configuration that ship with strandcast, and new projects that use them."""

import re
import shlex
import shutil
from pathlib import Path
from typing import Any

from strandcast.errors import StrandcastError

PACKAGE = Path(__file__).resolve().parents[1]
TEMPLATE = Path(__file__).with_name("template")
DEFAULT_PROFILE = "default"  # one machine
# As Snakemake names them: profile.yaml, or e.g. config.v8+.yaml for version 8 and later.
PROFILE_FILE = re.compile(r"(?:profile|config)(?:\.v(\d+)\+)?\.yaml")
ARMS = ("planar3", "ur5e-example", "fr3-example", "xarm6-example", "ur5e-space", "fr3-space")
CONFIG = (
    *(f"arms/{arm}.{end}" for arm in ARMS for end in ("toml", "urdf")),
    "experiments/demo.yaml",
    "examples/ur5e.yaml",
    "experiment.schema.json",
)


def shipped() -> Path:
    """Return the folder that holds the workflow/ and the config/ of this installation.

    A wheel has them in the package, where setup.py puts them; an editable installation has them in the clone.
    """
    packaged = PACKAGE / "shipped"
    return packaged if packaged.is_dir() else PACKAGE.parents[1]


def profile(root: Path, name: str = DEFAULT_PROFILE) -> Path:
    """Return a folder of Snakemake's settings: the project's own, or else one that ships.

    Parameters
    ----------
    name
        A folder in workflow/profiles, of the project or that ship, or the path of another one.

    Raises
    ------
    StrandcastError
        SC-W021 there is no such profile.
    """
    profiles = Path("workflow", "profiles")
    places = (profiles / name, shipped() / profiles / name, Path(name))
    folder = next((each for each in places if _profile_file(root / each) is not None), None)
    if folder is None:
        folders = {path for top in (root, shipped()) for path in (top / profiles).glob("*/")}
        known = sorted({path.name for path in folders if _profile_file(path) is not None})
        what = f"there is no profile {name!r}"
        fix = f"one of {', '.join(known)}, or the path of a folder with a profile.yaml"
        raise StrandcastError("SC-W021", what, field="--profile", fix=fix)
    return folder


def executor_of(folder: Path) -> str | None:
    """Return what runs the jobs by a profile, as ``slurm``; None for this computer.

    Raises
    ------
    StrandcastError
        SC-F002 the profile cannot be read; SC-W037 it has the project's files in object storage.
    """
    from strandcast.config.bounded import load_yaml, read_bounded  # slow to import

    path = _profile_file(folder)
    try:
        loaded = {} if path is None else load_yaml(read_bounded(path))
    except ValueError as error:
        raise StrandcastError("SC-F002", f"the profile cannot be read: {error}", file=path) from error
    settings: dict[str, Any] = loaded if isinstance(loaded, dict) else {}
    if "default-storage-provider" in settings:
        raise StrandcastError(
            "SC-W037",
            "the profile has raw data and results in object storage, and strandcast works with files on disk",
            file=path,
            cost="nothing was run",
            fix=f"let Snakemake run it: snakemake --workflow-profile {shlex.quote(str(folder))} "
            "--default-storage-prefix s3://BUCKET/PROJECT",
        )
    return settings.get("executor")


def _profile_file(folder: Path) -> Path | None:
    """Return the file of a profile that Snakemake reads, of several that for its latest version, or None."""
    files = folder.iterdir() if folder.is_dir() else ()
    found = [(int(match[1] or 0), path) for path in files if (match := PROFILE_FILE.fullmatch(path.name))]
    return max(found)[1] if found else None


def make_project(folder: Path) -> list[Path]:
    """Make a project: a Snakefile that uses the shipped workflow, an arm, the demo; return its files.

    Raises
    ------
    StrandcastError
        SC-E005 the folder is not empty, or is a file.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        what = "is not empty" if folder.is_dir() else "is a file"
        fix = "give the name of a folder that does not exist yet"
        raise StrandcastError("SC-E005", what, file=folder, cost="nothing was written", fix=fix)
    for name in ("data", "results"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    files = {folder / file.name.replace("gitignore", ".gitignore"): file for file in TEMPLATE.iterdir()}
    files |= {folder / "config" / name: shipped() / "config" / name for name in CONFIG}
    for path, source in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, path)
    return sorted(files)
