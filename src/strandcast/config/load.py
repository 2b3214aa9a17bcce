"""Read experiment.yaml and report all its errors at once, each with file, line, field and fix."""

import json
import logging
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from strandcast.config.bounded import BoundError, load_yaml, read_bounded
from strandcast.config.camera import LENS, MAIN, PLANE_PHOTO
from strandcast.config.experiment import Experiment
from strandcast.config.paper import with_method
from strandcast.config.problems import line_of, one_per_place, problem
from strandcast.config.renamed import with_new_names
from strandcast.core.objectives import OBJECTIVES
from strandcast.errors import StrandcastError, StrandcastErrors

log = logging.getLogger(__name__)
MOST_PROBLEMS = 50  # reported at once; chosen
PHOTOS = {"lens": Path(LENS), "plane_photo": Path(PLANE_PHOTO)}
SEEN_BY_ALL = ("board", "plane", "string_offset_m")  # the first camera's hold for the others too


def load_experiment(path: str | Path, text: str | None = None) -> Experiment:
    """Read experiment.yaml, or another text of it.

    Raises
    ------
    StrandcastErrors
        Every invalid setting, with line, field, value and suggestion.
    """
    path = Path(path)
    if not path.is_file():
        raise StrandcastError("SC-F001", "the experiment's file does not exist", file=path)
    try:
        data = load_yaml(read_bounded(path) if text is None else text, lines=True)
    except BoundError as error:
        raise StrandcastError("SC-F002", str(error), file=path, line=error.line) from None
    if not isinstance(data, CommentedMap):
        raise StrandcastError("SC-F002", "contains no settings", file=path)
    for change in with_new_names(data, path):
        log.warning("%s:%d: %s (`strandcast check --fix` does it)", path, change.line + 1, change.what)
    try:
        # JSON in strict mode: no "0.3" for 0.3, no true for 1, but a list may stand for a pair.
        experiment = Experiment.model_validate_json(
            json.dumps(with_method(_with_cameras(_with_target(_plain(data)))), default=str), strict=True
        )
    except ValidationError as error:
        found = one_per_place(data, [each for each in error.errors() if not _is_inherited(data, each["loc"])])
        raise StrandcastErrors(
            [problem(path, data, place, detail) for place, detail in found[:MOST_PROBLEMS]]
        ) from None
    except StrandcastError as error:
        error.file, error.line = str(path), line_of(data, (str(error.field),))
        raise
    if len(experiment.cameras) > 1:  # what they have by default was not given
        for name, given in _plain(data)["cameras"].items():
            experiment.cameras[name].model_fields_set.difference_update({*PHOTOS} - {*given})
    return experiment


def _is_inherited(data: CommentedMap, loc: tuple[int | str, ...]) -> bool:
    """Return whether an error is in what a camera has from the first one, where it is reported too."""
    cameras = _plain(data).get("cameras")
    match loc:
        case ("cameras", name, part, *_) if part in SEEN_BY_ALL and isinstance(cameras, dict):
            given = cameras.get(name)
            return name != next(iter(cameras)) and isinstance(given, dict) and part not in given
    return False


def _with_target(data: dict[str, Any]) -> dict[str, Any]:
    """Add the target where the settings give none but their objective implies one."""
    try:
        objective = data["objective"]
        kind = OBJECTIVES.find(str(objective["kind"]))
        target_m = None if kind is None else kind.default_target_m(objective)
    except (TypeError, KeyError, IndexError, ValueError):
        return data  # validation reports what is wrong or missing
    return data if target_m is None else {"target_m": target_m} | data


def _with_cameras(data: dict[str, Any]) -> dict[str, Any]:
    """Return settings with `camera: …` written out as `cameras: {main: …}`.

    A board in the plane has from the lens board what it does not give. Of several cameras, each has a folder
    of photos, and from the first what all see: the board and the plane.
    """
    if "camera" in data:
        if "cameras" in data:
            what = "both camera and cameras are given"
            fix = "move it into cameras, by name"
            raise StrandcastError("SC-F003", what, field="camera", fix=fix)
        data["cameras"] = {MAIN: data.pop("camera")}
    given = data["cameras"] if isinstance(data.get("cameras"), dict) else {}
    cameras = {name: camera for name, camera in given.items() if isinstance(camera, dict)}
    first = next(iter(cameras.values()), {})
    shared = {name: first[name] for name in SEEN_BY_ALL if name in first}
    for name, camera in cameras.items():
        if len(given) > 1:
            photos = {of: str(path.parent / name / path.name) for of, path in PHOTOS.items()}
            given[name] = camera = photos | shared | camera
        board, plane = (camera.get(part) for part in ("board", "plane"))
        if isinstance(board, dict) and isinstance(plane, dict) and isinstance(plane.get("board"), dict):
            camera["plane"] = plane | {"board": board | plane["board"]}
    return data


def _plain(node: Any) -> Any:
    """Return YAML's maps and lists as plain ones, with text as keys."""
    if isinstance(node, CommentedMap):
        return {str(key): _plain(value) for key, value in node.items()}
    return [_plain(value) for value in node] if isinstance(node, CommentedSeq) else node
