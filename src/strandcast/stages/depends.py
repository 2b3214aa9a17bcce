"""What a stage depends on besides its files: the settings that it uses, and its own code.

Snakemake sees neither an edit in `src/` nor which settings a stage reads; a rule's `params` tell it.
"""

from __future__ import annotations

import ast
import functools
import hashlib
from pathlib import Path
from typing import Any

from strandcast.experiment import Experiment
from strandcast.records.files import canonical_json

PACKAGE = Path(__file__).resolve().parent.parent

# Stage -> the parts of experiment.yaml that it reads.
SETTINGS: dict[str, tuple[str, ...]] = {
    "setup": (
        *("camera.board", "camera.plane", "workspace_m", "string.length_m", "seed", "target_m"),
        *("lab.camera", "lab.led", "align.led.x_m", "align.led.y_m"),
    ),
    "throw": (
        *("camera.plane", "workspace_m", "string", "seed", "lab", "target_m"),
        *("align.led.x_m", "align.led.y_m"),
    ),
    "ingest": ("camera.frame_rate_hz", "camera.missing_policy"),
    "calibrate": (
        *("camera.scale", "camera.lens_photos", "camera.plane_photo", "camera.board", "camera.plane"),
        *("camera.lens_video", "camera.distortion", "camera.string_offset_m", "camera.string_offset_sd_m"),
        *("workspace_m", "string.length_m", "track.background_frames"),
    ),
    "track": (
        *("string", "track", "camera.exposure_s", "target_m"),
        *(f"align.led.{name}" for name in ("x_m", "y_m", "radius_m", "box_px", "gamma")),
    ),
    "align": ("align",),
    "supply": ("string.length_m", "string.points"),
    "judge": ("target_m", "objective", "hit_radius_m"),
    "estimate": ("string", "estimate", "seed"),
    "plan": (
        *("string", "plan", "seed", "start_string", "workspace_m", "target_m", "objective", "hit_radius_m"),
        *("estimate.reading", "estimate.integrator", "estimate.dt_s", "estimate.joints"),
    ),
    "transfer": ("string", "estimate"),
    # The pages print all settings.
    "report": tuple(Experiment.model_fields),
    "summary": tuple(Experiment.model_fields),
}


def settings(experiment: Experiment, stage: str) -> str:
    """Return the settings that a stage reads, as one line of JSON."""
    return canonical_json({path: _at(experiment, path) for path in SETTINGS[stage]})


def _at(experiment: Experiment, path: str) -> Any:
    node: Any = experiment.model_dump(mode="json")
    for part in path.split("."):
        node = node[part] if node is not None else None  # a real experiment has no lab
    return node


@functools.cache
def code_version(stage: str) -> str:
    """Return a hash over a stage's module and all modules of strandcast that it imports.

    Comments, docstrings and layout do not count: the hash is over the syntax trees without docstrings.
    """
    digest = hashlib.sha256()
    for module in sorted(_closure(f"strandcast.stages.{stage}")):
        digest.update(module.encode() + b"\0" + _meaning(module))
    return digest.hexdigest()[:16]


def _closure(module: str) -> set[str]:
    seen: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            waiting.extend(_imports(name))
    return seen


def _file_of(module: str) -> Path | None:
    stem = PACKAGE.joinpath(*module.split(".")[1:])
    for path in (stem.with_suffix(".py"), stem / "__init__.py"):
        if path.is_file():
            return path
    return None


@functools.cache
def _tree(module: str) -> ast.Module:
    path = _file_of(module)
    return ast.parse(path.read_text(encoding="utf-8") if path else "")


@functools.cache
def _imports(module: str) -> tuple[str, ...]:
    """Return the modules of strandcast that a module imports anywhere, also within functions."""
    found: set[str] = set()
    for node in ast.walk(_tree(module)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return tuple(name for name in sorted(found) if name.startswith("strandcast.") and _file_of(name))


def _meaning(module: str) -> bytes:
    tree = ast.parse(ast.unparse(_tree(module)))
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and _is_docstring(body[0]):
            body[0] = ast.Pass()
    # Templates of the pages and other files beside the code count as code.
    folder = _file_of(module)
    others = sorted(folder.parent.rglob("*.jinja")) if folder and folder.name == "__init__.py" else []
    return ast.dump(tree).encode() + b"".join(path.read_bytes() for path in others)


def _is_docstring(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
