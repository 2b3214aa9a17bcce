"""Whether the packages that strandcast requires work: each is imported, and one call of it is made.

The list of installed packages does not say so: all distributions of OpenCV share the folder cv2, and what
removes one of them removes the files of another, which stays in the list.
"""

import importlib
import importlib.metadata
import importlib.util
import io
import logging
import re
import shlex
import sys
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from strandcast.errors import ENVIRONMENT, StrandcastError

OPENCV = "opencv-contrib-python-headless"
OTHER_OPENCVS = ("opencv-python", "opencv-python-headless", "opencv-contrib-python")


class Fault(NamedTuple):
    """Why a package does not work, and the command line that repairs it."""

    why: str
    fix: str


def _opencv(cv2: Any) -> None:
    """Find a marker, and thin a picture: the second is in OpenCV's contributed modules only."""
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    picture = markers.generateImageMarker(0, 64)
    cv2.aruco.ArucoDetector(markers).detectMarkers(picture)
    cv2.ximgproc.thinning(picture)


# Package -> the module of it that is imported, and a call of that which takes milliseconds.
PROBES: dict[str, tuple[str, Callable[[Any], object]]] = {
    "av": ("av", lambda av: av.VideoFrame(16, 16, "gray").to_ndarray()),
    "filelock": ("filelock", lambda filelock: filelock.FileLock("unused")),
    "jinja2": ("jinja2", lambda jinja2: jinja2.Template("{{ 1 }}").render()),
    "matplotlib": ("matplotlib.figure", lambda figure: figure.Figure().savefig(io.BytesIO())),
    "mujoco-core": ("mujoco", lambda mujoco: mujoco.MjModel.from_xml_string("<mujoco/>")),
    "numba": ("numba.core.registry", lambda registry: registry.cpu_target.target_context),  # of LLVM
    "numpy": ("numpy", lambda numpy: numpy.linalg.inv(numpy.eye(2))),
    OPENCV: ("cv2", _opencv),
    "pandas": ("pandas", lambda pandas: pandas.DataFrame({"a": [1]}).sum()),
    "pillow": ("PIL.Image", lambda image: image.new("L", (2, 2)).save(io.BytesIO(), "PNG")),
    "pyarrow": ("pyarrow.parquet", lambda parquet: parquet.write_table(*_table())),
    "pydantic": ("pydantic", lambda pydantic: pydantic.TypeAdapter(int).validate_json("1")),
    "rich": ("rich.console", lambda console: console.Console(file=io.StringIO()).print("a")),
    "ruamel.yaml": ("ruamel.yaml", lambda yaml: yaml.YAML(typ="safe").load("a: 1")),
    "ruckig": ("ruckig", lambda ruckig: ruckig.Ruckig(1, 0.01)),
    "scikit-image": ("skimage.morphology", lambda morphology: morphology.skeletonize(_square())),
    "scipy": ("scipy.linalg", lambda linalg: linalg.expm([[0.0]])),
    "snakemake": ("snakemake.cli", lambda cli: cli.get_argument_parser()),
    "threadpoolctl": ("threadpoolctl", lambda threadpoolctl: threadpoolctl.threadpool_info()),
    "tifffile": ("tifffile", lambda tifffile: tifffile.imwrite(io.BytesIO(), _square())),
    "typer": ("typer.main", lambda main: main.get_command(main.Typer(callback=lambda: None))),
}


def _table() -> tuple[Any, io.BytesIO]:
    return importlib.import_module("pyarrow").table({"a": [1]}), io.BytesIO()


def _square() -> Any:
    return importlib.import_module("numpy").ones((4, 4), bool)


def installed_version(package: str) -> str | None:
    """Return a package's version, as the list of installed packages has it; None: it is not in the list."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def optional_package(module: str, package: str, extra: str, instead: str = "") -> Any:
    """Return a module of a package that only one import or export needs (SC-W012 if it is not installed)."""
    try:
        return importlib.import_module(module)
    except ImportError:
        what, fix = f"this needs the package {package}", f'pip install "strandcast[{extra}]"{instead}'
        raise StrandcastError("SC-W012", what, fix=fix, exit_code=ENVIRONMENT) from None


def fault_of(package: str) -> Fault | None:
    """Return why a package does not work; None: it does, or there is no probe of it."""
    if package not in PROBES:
        return None
    (name, call), top = PROBES[package], top_module(package)
    try:
        module = importlib.import_module(top)
        if getattr(module, "__file__", None) is None and package != "ruamel.yaml":  # that shares `ruamel`
            raise ImportError(f"of {top} only folders without code are left", name=top)
        call(importlib.import_module(name))
    except Exception as error:
        text = f"{error}".splitlines()[0] if str(error) else type(error).__name__
        return Fault(f"{text}{_removed_with(package)}", _repair(package, error))
    return None


def _repair(package: str, error: Exception) -> str:
    """Return what installs again what an error names: the package, or another that it needs."""
    top = str(getattr(error, "name", None)).partition(".")[0]
    if isinstance(error, ImportError) and top != top_module(package):
        needed = importlib.metadata.packages_distributions().get(top, [])
        if needed:
            return reinstall(needed[0])
        if isinstance(error, ModuleNotFoundError):  # not in the list of installed packages
            return install([f"{package}=={installed_version(package)}"])
    return reinstall(package)


def _removed_with(package: str) -> str:
    if package != OPENCV:
        return ""
    others = other_opencvs()
    if others:
        return f"; {' and '.join(others)}, in the same folder, may have replaced it"
    return "; another OpenCV, in the same folder, may have been removed"


def other_opencvs() -> list[str]:
    """Return the other distributions of OpenCV that are installed here: all share the folder cv2."""
    return [name for name in OTHER_OPENCVS if installed_version(name) is not None]


def is_own_opencv() -> bool:
    """Return whether the files in the folder cv2 are those of the OpenCV that strandcast requires."""
    try:
        files: Any = importlib.import_module("cv2.version")
    except ImportError:
        return False
    same = installed_version(OPENCV) in (None, files.opencv_version)
    return bool(same and files.contrib and files.headless)


def reinstall(package: str) -> str:
    """Return the command line that installs a package again in this environment, in its present version."""
    return install([f"{package}=={installed_version(package)}"], "--force-reinstall", "--no-deps")


def install(requirements: list[str], *options: str) -> str:
    """Return a command line that installs packages, and before OpenCV removes what would share its folder."""
    others = other_opencvs() if OPENCV in map(requirement_name, requirements) else []
    first = f"{_installer('uninstall', '--yes')} {' '.join(others)} && " if others else ""
    return f"{first}{_installer('install', *options)} {shlex.join(requirements)}"


def _installer(verb: str, *options: str) -> str:
    python = shlex.quote(sys.executable)
    if importlib.util.find_spec("pip") is None:  # made by uv, which asks nothing
        kept = [each for each in options if each != "--yes"]
        return " ".join(["uv pip", verb, "--python", python, *kept])
    return " ".join([python, "-m pip", verb, *options])


def requirement_name(requirement: str) -> str:
    """Return the name of the package that a requirement asks for, e.g. ``filelock`` of ``filelock>=4``."""
    return re.split(r"[^\w.-]", requirement)[0].lower()


def top_module(package: str) -> str:
    """Return the module that a package is imported by, e.g. ``PIL``."""
    return PROBES[package][0].partition(".")[0]


def _faults(names: Iterable[str]) -> dict[str, Fault]:
    return {name: fault for name in names if (fault := fault_of(name)) is not None}


def broken_package(error: Exception) -> StrandcastError | None:
    """Return, after an unexpected error, which installed package does not work; None: all of them work.

    A package that is not in the list of installed ones is left out: a robot's computer has few of them.
    """
    names = [name for name in PROBES if installed_version(name) is not None]
    # Mostly, the error comes from one of these.
    used = [name for name in names if top_module(name) in sys.modules]
    faults = _faults(used) or _faults(name for name in names if name not in used)
    if not faults:
        return None
    logging.getLogger(__name__).info("the error was", exc_info=error)
    what = "; ".join(f"{name} {installed_version(name)} does not work: {faults[name].why}" for name in faults)
    fix = f"install it again: {' && '.join(dict.fromkeys(fault.fix for fault in faults.values()))}"
    return StrandcastError("SC-W013", what, fix=fix, exit_code=ENVIRONMENT)
