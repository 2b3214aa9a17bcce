"""The JSON schema of experiment.yaml, and the groups of settings behind its fields."""

import json
from typing import Any, get_args

from pydantic import BaseModel

from strandcast.config.experiment import Experiment
from strandcast.core.objectives import OBJECTIVES, Objective

SCHEMA_FILE = "config/experiment.schema.json"


def json_schema() -> str:
    """Return the JSON schema of experiment.yaml; config/experiment.schema.json holds it."""
    schema = Experiment.model_json_schema()
    schema["properties"] = _with_short_camera(schema["properties"])
    return json.dumps(schema, indent=1) + "\n"


def _with_short_camera(properties: dict[str, Any]) -> dict[str, Any]:
    """Return the properties with `camera`, which `load_experiment` reads as `cameras: {main: …}`."""
    camera = {
        "$ref": "#/$defs/CameraSettings",
        "description": "The set-up of the only camera: short for `cameras: {main: …}`.",
    }
    names = list(properties)
    names.insert(names.index("cameras"), "camera")
    return {name: properties.get(name, camera) for name in names}


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """Return the groups of settings that a field's annotation names, in order."""
    if annotation is Objective:
        return list(OBJECTIVES.known().values())
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]
