"""The experiments' files under data/, made from config/paper.yaml."""

from __future__ import annotations

import io
import json
from pathlib import Path

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.experiment import Experiment
from strandcast.paper.cases import FILE, Case, Plan, settings_of, wrong_fields
from strandcast.records.files import write_text

HEAD = "# Written by `strandcast paper` from {file}; the method is `{method}`.\n"


def write_experiments(root: Path, plan: Plan, cases: list[Case]) -> list[Path]:
    """Write data/<name>/experiment.yaml of every experiment that has none; returns the files written.

    A file that is there stays as it is.

    Raises
    ------
    StrandcastErrors
        SC-Z002 the settings do not make an experiment, SC-Z004 files that are there say something else;
        nothing is written then.
    """
    texts = {root / "data" / case.name / "experiment.yaml": text_of(plan, case) for case in cases}
    new = {path: text for path, text in texts.items() if not path.is_file()}
    others = [path for path in texts if path not in new and not _says(path, texts[path])]
    if others:
        raise StrandcastErrors([_another(path) for path in others])
    for path, text in new.items():
        write_text(path, text)
    return list(new)


def text_of(plan: Plan, case: Case) -> str:
    """Return the text of an experiment's file."""
    settings = settings_of(plan, case)
    try:
        Experiment.model_validate_json(json.dumps(settings), strict=True)
    except ValidationError as error:
        raise wrong_fields(error, FILE) from None
    out = io.StringIO()
    yaml = YAML(typ="rt")
    yaml.default_flow_style = None  # lists of numbers in one line
    yaml.width = 110
    yaml.representer.ignore_aliases = lambda data: True
    yaml.dump(settings, out)
    return HEAD.format(file=FILE.as_posix(), method=case.method) + out.getvalue()


def _says(path: Path, text: str) -> bool:
    """Tell whether a file says the same as a text; comments and layout do not count."""
    yaml = YAML(typ="safe")
    try:
        return bool(yaml.load(path.read_text(encoding="utf-8")) == yaml.load(text))
    except (YAMLError, UnicodeDecodeError):
        return False


def _another(path: Path) -> StrandcastError:
    name = path.parent.name
    return StrandcastError(
        "SC-Z004",
        f"says something else than {FILE.as_posix()} now does",
        file=path,
        cost="its throws are not those of the others",
        fix=f"take that change back, or throw anew: delete data/{name} and results/{name}",
    )
