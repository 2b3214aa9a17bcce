"""Change which trials an experiment's file excludes; every other line of it stays as it is."""

import io
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from strandcast.config.bounded import load_yaml, read_bounded
from strandcast.config.experiment import Experiment
from strandcast.config.load import load_experiment
from strandcast.errors import StrandcastError
from strandcast.records.files import write_bytes

KEY = "excluded"
WIDEST = 4096  # columns: no line is broken


def set_excluded(path: Path, trial: int, reason: str | None) -> bool:
    """Exclude a trial for a reason, or with None include it again; return whether the file changed.

    Raises
    ------
    StrandcastError
        The settings are invalid, or would be; SC-F003 the list cannot be edited without changing other
        settings; SC-W002 the file cannot be written.
    """
    settings = load_experiment(path)
    if _listed(settings, trial) == reason:
        return False
    edited = _edited(read_bounded(path), trial, reason)
    try:
        after = load_experiment(path, edited)
    except StrandcastError as error:
        if reason is not None and not 0 < len(reason) <= 500:
            raise
        raise _by_hand(path, trial) from error
    others = after.model_copy(update={KEY: settings.excluded})
    if others != settings or _listed(after, trial) != reason:
        raise _by_hand(path, trial)
    write_bytes(path.resolve(), edited.encode())  # a link stays a link
    return True


def _listed(settings: Experiment, trial: int) -> str | None:
    """Return the reason that the list gives for a trial; trials that are held out are in another."""
    return next((each.reason for each in settings.excluded if each.trial == trial), None)


def _by_hand(path: Path, trial: int) -> StrandcastError:
    what = "the list cannot be edited without changing other settings"
    fix = f"edit the line by hand: {KEY}: [{{trial: {trial}, reason: …}}]"
    return StrandcastError("SC-F003", what, file=path, field=KEY, fix=fix)


def _edited(text: str, trial: int, reason: str | None) -> str:
    """Return the file's text with another list; only the lines of the list differ."""
    newline = "\r\n" if "\r\n" in text else "\n"
    lines = [line.rstrip("\r\n") for line in io.StringIO(text)]  # a title may hold other ends of lines
    first, last = _place(text, lines)
    yaml = YAML(typ="rt")
    yaml.width, yaml.preserve_quotes = WIDEST, True
    yaml.indent(mapping=2, sequence=4, offset=2)
    block = yaml.load("\n".join(lines[first:last])) or CommentedMap()
    trials = block.get(KEY) or CommentedSeq()
    at = next((k for k, each in enumerate(trials) if each["trial"] == trial), None)
    if reason is None and at is not None:
        del trials[at]
    elif at is not None:
        trials[at]["reason"] = reason
    else:
        entry = CommentedMap(trial=trial, reason=reason)
        entry.fa.set_flow_style()
        trials.append(entry)
    block[KEY] = trials
    comments = [line for line in lines[first:last] if line.lstrip().startswith("#")]
    out = io.StringIO()
    yaml.dump(block, out)
    new = out.getvalue().splitlines() if trials else comments
    return newline.join([*lines[:first], *new, *lines[last:]]) + newline


def _place(text: str, lines: list[str]) -> tuple[int, int]:
    """Return the lines of the list, first and last + 1; without a list, the end of the file."""
    data = load_yaml(text, lines=True)
    starts = sorted(data.lc.data[key][0] for key in data)
    if KEY not in data:
        return len(lines), len(lines)
    first = data.lc.data[KEY][0]
    last = next((start for start in starts if start > first), len(lines))
    while last > first + 1 and (not lines[last - 1].strip() or lines[last - 1].startswith("#")):
        last -= 1  # comments of the next setting
    return first, last
