"""The names of trials: trial-01 to trial-99, then trial-100 to trial-999999."""

import re
from collections.abc import Iterable

LAST_TRIAL = 999_999  # chosen: an arm that throws every 5 s reaches it in two months
# At least two digits, and no zero before three or more: each number has one name.
TRIAL_DIGITS = f"0[1-9]|[1-9][0-9]{{1,{len(str(LAST_TRIAL)) - 1}}}"
PREFIX = "trial-"
TRIAL_NAMES = f"{PREFIX}01 to {PREFIX}99, then {PREFIX}100 to {PREFIX}{LAST_TRIAL}"  # in messages
_NAME = re.compile(f"{PREFIX}({TRIAL_DIGITS})")
_NUMBER = re.compile(f"(?<={PREFIX})[0-9]+")


def trial_digits(number: int) -> str:
    """Return the number of a trial as its folder's name has it, e.g. 01 or 100."""
    return f"{number:02d}"


def trial_name(number: int) -> str:
    """Return the folder name of a trial, e.g. trial-01 or trial-100."""
    return PREFIX + trial_digits(number)


def trial_number(name: str) -> int:
    """Return the number of a trial from its folder's name, 0 if it is no trial's name."""
    found = _NAME.fullmatch(name)
    return int(found[1]) if found else 0


def in_trial_order(paths: Iterable[str]) -> list[str]:
    """Return paths in the order of their names, but those of trials by number: trial-100 after trial-99."""
    width = len(str(LAST_TRIAL))
    return sorted(paths, key=lambda path: _NUMBER.sub(lambda found: found[0].zfill(width), path))
