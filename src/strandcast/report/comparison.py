"""Two sets of results side by side, trial by trial: two settings, two versions or two experiments."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from strandcast.errors import StrandcastError
from strandcast.records.alignment import Alignment
from strandcast.records.estimate import Estimate
from strandcast.records.manifest import Manifest
from strandcast.records.record import Record
from strandcast.records.track import TrackSummary
from strandcast.records.verdict import Verdict

RECORDS: dict[str, type[Record]] = {
    "verdict": Verdict,
    "estimate": Estimate,
    "alignment": Alignment,
    "track": TrackSummary,
    "manifest": Manifest,
}
# How the fit was done; what differs between two results is listed.
FIT_SETTINGS = (
    "length_m",
    "points",
    "reading",
    "dt_s",
    "search",
    "ranges",
    "start_shape",
    "evaluation",
    "w",
    "seed",
    "trials_used",
    "evaluations",
)
LOG_UNIT = "log10 "  # before the unit of a number that is compared by its logarithm


class Value(NamedTuple):
    """A number and its standard deviation, each None where it is not known."""

    value: float | None = None
    sigma: float | None = None

    def less(self, other: "Value") -> "Value":
        """Return the difference to another value; its σ as if the two were independent."""
        if self.value is None or other.value is None:
            return Value()
        known = [each for each in (self.sigma, other.sigma) if each is not None]
        return Value(self.value - other.value, math.hypot(*known) if len(known) == 2 else None)


@dataclass(frozen=True)
class TrialRecords:
    """The records of one trial that could be read, by the names of `RECORDS`, and wall times by stage."""

    records: Mapping[str, Any]
    times_s: Mapping[str, float] = field(default_factory=dict)

    def get(self, name: str, attribute: str) -> Any | None:
        """Return an attribute of a record, or None."""
        return getattr(self.records.get(name), attribute, None)


class Row(NamedTuple):
    """One quantity of one trial, in both results, and the difference B − A."""

    trial: int
    quantity: str
    unit: str
    a: Value
    b: Value

    @property
    def difference(self) -> Value:
        """Return B − A."""
        return self.b.less(self.a)

    def to_json(self) -> dict[str, Any]:
        """Return the row as plain data."""
        values = {"a": self.a, "b": self.b, "difference": self.difference}
        return {"trial": self.trial, "quantity": self.quantity, "unit": self.unit} | {
            name: value._asdict() for name, value in values.items()
        }


class Tally(NamedTuple):
    """In how many trials a quantity is lower in B; p: the two-sided sign test."""

    quantity: str
    lower: int
    higher: int
    p: float


@dataclass(frozen=True)
class Comparison:
    """Two sets of results, paired by trial."""

    names: tuple[str, str]
    trials: list[int]
    unpaired: tuple[list[int], list[int]]
    same_recording: dict[int, bool | None]  # None: not known
    rows: list[Row]
    tallies: list[Tally]
    settings: list[tuple[str, str, str]]  # what differs: name, in A, in B

    def to_json(self) -> dict[str, Any]:
        """Return the comparison as plain data."""
        return {
            "a": self.names[0],
            "b": self.names[1],
            "trials": self.trials,
            "only_a": self.unpaired[0],
            "only_b": self.unpaired[1],
            "same_recording": self.same_recording,
            "rows": [row.to_json() for row in self.rows],
            "sign_tests": [tally._asdict() for tally in self.tallies],
            "differing": [{"name": name, "a": a, "b": b} for name, a, b in self.settings],
        }


def read_records(folder: Path) -> dict[str, Record]:
    """Return the records in a trial's folder that can be read."""
    found = {}
    for name, kind in RECORDS.items():
        try:
            found[name] = kind.read(folder / f"{name}.json")
        except StrandcastError:
            continue
    return found


def compare(
    names: tuple[str, str], a: Mapping[int, TrialRecords], b: Mapping[int, TrialRecords]
) -> Comparison:
    """Compare two sets of results by trial.

    Raises
    ------
    StrandcastError
        SC-W022 no trial is in both.
    """
    trials = sorted(a.keys() & b.keys())
    if not trials:
        has = [
            f"{name} has {', '.join(map(str, sorted(each))) or 'none'}"
            for name, each in zip(names, (a, b), strict=True)
        ]
        raise StrandcastError(
            "SC-W022",
            f"no trial is in both: {'; '.join(has)}",
            fix="compare results that share trial numbers, e.g. two runs on the same recordings",
        )
    rows = [row for trial in trials for row in _rows(trial, a[trial], b[trial])]
    return Comparison(
        names,
        trials,
        (sorted(a.keys() - b.keys()), sorted(b.keys() - a.keys())),
        {trial: _same_recording(a[trial], b[trial]) for trial in trials},
        rows,
        [tally for quantity in TALLIED if (tally := _tally(quantity, rows)).lower + tally.higher],
        _differing(a[trials[-1]], b[trials[-1]]),
    )


def _rows(trial: int, a: TrialRecords, b: TrialRecords) -> list[Row]:
    rows = [
        Row(
            trial,
            name,
            unit,
            *(Value(each.get(record, size), each.get(record, sigma)) for each in (a, b)),
        )
        for name, (unit, record, size, sigma) in MEASURED.items()
    ]
    times_s = (Value(sum(each.times_s.values()) if each.times_s else None) for each in (a, b))
    rows.append(Row(trial, WALL_TIME, "s", *times_s))
    strings = parameters_of(a), parameters_of(b)
    for name in strings[0] | strings[1]:
        unit = next(each[name][0] for each in strings if name in each)
        rows.append(Row(trial, name, unit, *(each.get(name, ("", Value()))[1] for each in strings)))
    return [row for row in rows if row.a.value is not None or row.b.value is not None]


def parameters_of(trial: TrialRecords) -> dict[str, tuple[str, Value]]:
    """Return the fitted parameters by name: unit and value; decades of it where it cannot be negative."""
    estimate: Estimate | None = trial.records.get("estimate")
    if estimate is None:
        return {}
    known = estimate.uncertainty
    sigmas = {} if known is None else dict(zip(known.unknowns, known.marginal_sd, strict=True))
    found = {}
    for fit in estimate.parameters:
        decades = math.log10(fit.value) if fit.value > 0.0 else None
        found[fit.name] = (f"{LOG_UNIT}{fit.unit}".rstrip(), Value(decades, sigmas.get(fit.name)))
    for name, value in estimate.options.items():
        found[name] = ("", Value(value, sigmas.get(name)))
    return found


# Unit, record, its field, and the field of the standard deviation if there is one.
MEASURED = {
    "miss": ("m", "verdict", "miss_m", "miss_sigma_m"),
    "E as planned": ("m", "estimate", "E_planned_m", ""),
    "E after the fit": ("m", "estimate", "E_m", ""),
    "tip error": ("m", "estimate", "tip_error_m", ""),
    "clock offset": ("s", "alignment", "offset_s", "offset_se_s"),
    "tracked fraction": ("1", "track", "tracked_fraction", ""),
}
WALL_TIME = "wall time"
QUANTITIES = (*MEASURED, WALL_TIME)
TALLIED = ("miss", "E after the fit", WALL_TIME)


def _tally(quantity: str, rows: list[Row]) -> Tally:
    found = [row.difference.value or 0.0 for row in rows if row.quantity == quantity]
    lower, higher = sum(each < 0.0 for each in found), sum(each > 0.0 for each in found)
    return Tally(quantity, lower, higher, sign_test(lower, higher))


def sign_test(lower: int, higher: int) -> float:
    """Return how likely chance alone makes the signs at least this unequal (two-sided); 1 without pairs."""
    n, least = lower + higher, min(lower, higher)
    return min(1.0, 2.0 * sum(math.comb(n, k) for k in range(least + 1)) / 2.0**n)


def _same_recording(a: TrialRecords, b: TrialRecords) -> bool | None:
    one, other = (each.get("manifest", "video") for each in (a, b))
    return None if one is None or other is None else bool(one.sha256 == other.sha256)


def _differing(a: TrialRecords, b: TrialRecords) -> list[tuple[str, str, str]]:
    """Return what differs in how the last trial was fitted, and in the versions that made it."""
    found: list[tuple[str, Any, Any]] = [
        (name, a.get("estimate", name), b.get("estimate", name)) for name in FIT_SETTINGS
    ]
    versions = [each.get("estimate", "made_by") or {} for each in (a, b)]
    names = sorted(versions[0].keys() | versions[1].keys())
    found += [(f"version of {name}", versions[0].get(name), versions[1].get(name)) for name in names]
    return [(name, _text(one), _text(other)) for name, one, other in found if one != other]


def _text(value: Any) -> str:
    return "–" if value is None else ", ".join(map(str, value)) if isinstance(value, list) else str(value)
