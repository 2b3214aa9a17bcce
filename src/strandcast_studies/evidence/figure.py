"""One figure of the evidence: a number with its unit, its target if there is one, and a note."""

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Figure:
    """A measured figure."""

    name: str  # data set, quantity and series, with dots
    value: float | None  # None if not available
    unit: str
    target: float | None = None  # largest acceptable magnitude of `value`
    note: str = ""  # how it was measured, or an explanation
    detail: dict[str, Any] | None = None  # related numbers, by names with units

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None without a target."""
        if self.target is None:
            return None
        return self.value is not None and abs(self.value) <= self.target

    def record(self) -> dict[str, Any]:
        """Return the figure as a JSON object, without empty fields."""
        full = (asdict(self) | {"met": self.met}).items()
        return {key: item for key, item in full if key in ("name", "value", "unit") or item not in (None, "")}


@dataclass(frozen=True)
class Skipped:
    """A data set that could not be measured, and why."""

    name: str
    reason: str

    def record(self) -> dict[str, Any]:
        """Return the data set's name and the reason as a JSON object."""
        return {"name": self.name, "skipped": self.reason}
