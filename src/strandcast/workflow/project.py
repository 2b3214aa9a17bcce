"""The workflow and the configuration that ship with strandcast, and new projects that use them."""

import shutil
from pathlib import Path

from strandcast.errors import StrandcastError

PACKAGE = Path(__file__).resolve().parents[1]
TEMPLATE = Path(__file__).with_name("template")
CONFIG = (
    *(f"arms/{arm}.{end}" for arm in ("planar3", "ur5e-example", "fr3-example") for end in ("toml", "urdf")),
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


def profile(root: Path) -> Path:
    """Return the folder of Snakemake's settings: the project's own, or else those that ship."""
    own = Path("workflow", "profiles", "default")
    return own if (root / own).is_dir() else shipped() / own


def make_project(folder: Path) -> list[Path]:
    """Make a project: a Snakefile that uses the shipped workflow, an arm, the demo; return its files.

    Raises
    ------
    StrandcastError
        SC-W011 the folder is not empty, or is a file.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise StrandcastError(
            "SC-W011",
            "is not empty" if folder.is_dir() else "is a file",
            file=folder,
            cost="nothing was written",
            fix="give the name of a folder that does not exist yet",
        )
    for name in ("data", "results"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    files = {folder / file.name.replace("gitignore", ".gitignore"): file for file in TEMPLATE.iterdir()}
    files |= {folder / "config" / name: shipped() / "config" / name for name in CONFIG}
    for path, source in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, path)
    return sorted(files)
