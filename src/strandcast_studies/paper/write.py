"""Write the experiments' files under data/ from config/paper.yaml."""

import io
import json
from pathlib import Path

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from strandcast.config.experiment import Experiment
from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.records.files import write_text
from strandcast_studies.paper.cases import FILE, PaperCase, PaperPlan, settings_of, wrong_fields

HEAD = "# Written by `make paper` from {file}; the method is `{method}`.\n"


def write_experiments(root: Path, plan: PaperPlan, cases: list[PaperCase]) -> list[Path]:
    """Write data/<name>/experiment.yaml of every case that has none, and return the files written.

    Existing files are not changed.

    Raises
    ------
    StrandcastErrors
        SC-Z002 the settings are not a valid experiment, SC-Z004 existing files differ; nothing is written.
    """
    texts = {root / "data" / case.name / "experiment.yaml": text_of(plan, case) for case in cases}
    new = {path: text for path, text in texts.items() if not path.is_file()}
    others = [path for path in texts if path not in new and not _says(path, texts[path])]
    if others:
        raise StrandcastErrors([_another(path) for path in others])
    for path, text in new.items():
        write_text(path, text)
    return list(new)


def text_of(plan: PaperPlan, case: PaperCase) -> str:
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
    """Return whether a file has the same content as a text, apart from comments and layout."""
    yaml = YAML(typ="safe")
    try:
        return bool(yaml.load(path.read_text(encoding="utf-8")) == yaml.load(text))
    except (YAMLError, UnicodeDecodeError):
        return False


def _another(path: Path) -> StrandcastError:
    name = path.parent.name
    return StrandcastError(
        "SC-Z004",
        f"differs from what {FILE.as_posix()} now specifies",
        file=path,
        cost="its throws would not be comparable with the others",
        fix=f"undo that change, or start again: delete data/{name} and results/{name}",
    )
