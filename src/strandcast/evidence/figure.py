"""One figure of the evidence: a number with its unit, its target where there is one, and honest words."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Figure:
    """A measured figure.

    Attributes
    ----------
    name
        What was measured, in dotted words: data set, quantity, series.
    value, unit
        The number, None where it could not be had, and its unit.
    target
        Largest magnitude of `value` that is good enough; None for a figure without a target.
    note
        How it was measured, or why it is what it is.
    detail
        Numbers that belong to it, by names that carry their units.
    """

    name: str
    value: float | None
    unit: str
    target: float | None = None
    note: str = ""
    detail: dict[str, Any] | None = None

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None without a target."""
        if self.target is None:
            return None
        return self.value is not None and abs(self.value) <= self.target

    def record(self) -> dict[str, Any]:
        """Return the figure as a JSON object, without what is not there."""
        full = asdict(self) | {"met": self.met}
        always = ("name", "value", "unit")
        return {key: item for key, item in full.items() if key in always or item not in (None, "")}


@dataclass(frozen=True)
class Skipped:
    """A data set that could not be measured, and why."""

    name: str
    reason: str

    def record(self) -> dict[str, Any]:
        """Return it as a JSON object."""
        return {"name": self.name, "skipped": self.reason}
