"""config/paper.yaml: which string is thrown at which target, with which seed and method."""

from __future__ import annotations

import json
import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from strandcast.config.paper import with_method
from strandcast.config.string import String
from strandcast.core.section import Section
from strandcast.errors import StrandcastError, StrandcastErrors

FILE = Path("config") / "paper.yaml"
WHOLE, QUICK = "paper", "paper-quick"  # folders of results, and how the experiments' names begin
METHODS = ("paper", "default")
NAME = re.compile(rf"({WHOLE}|{QUICK})-string(\d+)-target(\d+)-seed(\d+)-({'|'.join(METHODS)})")

Number = Annotated[int, Field(ge=1, le=99)]
Method = Literal["paper", "default"]


class PaperTarget(Section):
    """A target, printed in the paper or chosen by us."""

    number: Number
    target_m: tuple[float, float]
    source: Literal["paper", "ours"]


class PaperString(Section):
    """One of the paper's strings, its own target and further ones."""

    number: Number
    target: Number
    also: list[Number] = []
    string: String


class QuickForm(Section):
    """The reduced seeds, strings and settings of the quick form."""

    seeds: Annotated[int, Field(ge=1, le=99)]
    strings: list[Number]
    settings: dict[str, Any]


class PaperPlan(Section):
    """config/paper.yaml as one typed object."""

    first_seed: Annotated[int, Field(ge=0, le=2**30)]
    seeds: Annotated[int, Field(ge=1, le=999)]
    targets: list[PaperTarget]
    strings: list[PaperString]
    common: dict[str, Any]
    methods: dict[Method, dict[str, Any]]
    quick: QuickForm

    @model_validator(mode="after")
    def _references_exist(self) -> PaperPlan:
        known = {target.number for target in self.targets}
        wanted = {number for one in self.strings for number in (one.target, *one.also)}
        if wanted - known:
            raise ValueError(f"there is no target {min(wanted - known)}")
        if set(self.quick.strings) - {one.number for one in self.strings}:
            raise ValueError("quick.strings has a string that is not defined")
        return self

    def target(self, number: int) -> PaperTarget:
        """Return a target by number."""
        return next(target for target in self.targets if target.number == number)

    def string(self, number: int) -> PaperString:
        """Return a string by number."""
        return next(one for one in self.strings if one.number == number)


@dataclass(frozen=True, order=True)
class PaperCase:
    """One of the experiments: one string, target, seed and method; `form` is `paper` or `paper-quick`."""

    form: str
    seed: int
    string: int
    target: int
    method: str

    @property
    def name(self) -> str:
        """Return the experiment's name, e.g. paper-string1-target1-seed101-default."""
        return f"{self.form}-string{self.string}-target{self.target}-seed{self.seed}-{self.method}"


def case_of(name: str) -> PaperCase | None:
    """Return the case of an experiment's name, or None if it is not one of the paper's."""
    found = NAME.fullmatch(name)
    if found is None:
        return None
    form, string, target, seed, method = found.groups()
    return PaperCase(form, int(seed), int(string), int(target), method)


def load_plan(path: Path) -> PaperPlan:
    """Read config/paper.yaml.

    Raises
    ------
    StrandcastError
        SC-Z001 the file is missing or not YAML, SC-Z002 invalid fields, all of them.
    """
    try:
        data = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, YAMLError) as error:
        what = str(error).splitlines()[0]
        raise StrandcastError("SC-Z001", what, file=path, fix="restore the file") from None
    try:
        return PaperPlan.model_validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        raise wrong_fields(error, path) from None


def wrong_fields(error: ValidationError, path: Path) -> StrandcastErrors:
    """Return the errors of all invalid fields of a file."""
    return StrandcastErrors(
        [
            StrandcastError(
                "SC-Z002",
                detail["msg"],
                file=path,
                field=".".join(map(str, detail["loc"])),
                fix="correct the field, or restore the file",
            )
            for detail in error.errors()
        ]
    )


def cases(
    plan: PaperPlan,
    *,
    quick: bool = False,
    seeds: int | None = None,
    strings: Collection[int] = (),
    targets: Collection[int] = (),
    methods: Collection[str] = (),
) -> list[PaperCase]:
    """Return the cases in the order in which they run: by seed, then by string.

    Parameters
    ----------
    plan
        config/paper.yaml.
    quick
        The quick form: fewer strings and seeds, and less effort.
    seeds
        Number of seeds from the first; by default the file's.
    strings, targets, methods
        Only these, if any are given.

    Raises
    ------
    StrandcastError
        SC-Z003 there is no such string, target or method; nothing is left.
    """
    known = plan.quick.strings if quick else [one.number for one in plan.strings]
    thrown_at = sorted({t for one in plan.strings for t in (one.target, *([] if quick else one.also))})
    _refuse_unknown("string", strings, known)
    _refuse_unknown("target", targets, thrown_at)
    _refuse_unknown("method", methods, plan.methods)
    count = seeds or (plan.quick.seeds if quick else plan.seeds)
    chosen = [
        PaperCase(QUICK if quick else WHOLE, plan.first_seed + k, one.number, target, method)
        for k in range(count)
        for one in plan.strings
        if one.number in known and (not strings or one.number in strings)
        for target in (one.target, *([] if quick else one.also))
        if not targets or target in targets
        for method in METHODS
        if method in plan.methods and (not methods or method in methods)
    ]
    if not chosen:
        raise StrandcastError(
            "SC-Z003",
            "no experiment is left by this choice",
            fix="not every string is thrown at every target: see config/paper.yaml",
        )
    return chosen


def _refuse_unknown(what: str, wanted: Collection[Any], known: Collection[Any]) -> None:
    unknown = [str(one) for one in wanted if one not in known]
    if unknown:
        raise StrandcastError(
            "SC-Z003",
            f"there is no {what} {', '.join(unknown)}",
            field=f"{what}s",
            fix=f"one of {', '.join(map(str, known))}",
        )


def words_in(text: str) -> list[str]:
    """Return the words of a comma-separated list."""
    return [word.strip() for word in text.split(",") if word.strip()]


def numbers_in(text: str) -> list[int]:
    """Return the numbers of a comma-separated list.

    Raises
    ------
    StrandcastError
        SC-Z003 one of them is not a number.
    """
    try:
        return [int(word) for word in words_in(text)]
    except ValueError:
        raise StrandcastError(
            "SC-Z003", f"{text!r} is not a list of numbers", fix="write, for example, 1,3"
        ) from None


def settings_of(plan: PaperPlan, case: PaperCase) -> dict[str, Any]:
    """Return the contents of a case's experiment.yaml as plain data."""
    target, string = plan.target(case.target), plan.string(case.string)
    placed = "printed in the paper" if target.source == "paper" else "ours"
    own = {
        "title": f"The paper's string {case.string} at target {case.target} ({placed}), by "
        + ("the paper's method" if case.method == "paper" else "strandcast's defaults"),
        "string": string.string.model_dump(mode="json", exclude_unset=True),
        "target_m": list(target.target_m),
        "seed": case.seed,
        "lab": {"string": f"paper-{case.string}"},
    }
    method = next(settings for name, settings in plan.methods.items() if name == case.method)
    less = plan.quick.settings if case.form == QUICK else {}
    return with_method(merged(own, plan.common, method, less))


def merged(*parts: dict[str, Any]) -> dict[str, Any]:
    """Return nested settings merged; later ones override earlier ones."""
    whole: dict[str, Any] = {}
    for part in parts:
        for key, value in part.items():
            mine = whole.get(key)
            if isinstance(mine, dict) and isinstance(value, dict):
                value = merged(mine, value)
            whole[key] = value
    return whole
