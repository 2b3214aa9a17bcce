"""Facts that the pages show besides the results: values from the experiment's and the arm's files."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Facts:
    """Plain values from the settings."""

    title: str = ""
    hit_radius_m: float = 0.02
    # Places to mark: a bar's two ends, a shape's places; none for a swing. None: the motion's target.
    aims_m: list[tuple[float, float]] | None = None
    excluded: dict[int, str] = field(default_factory=dict)  # trial -> why it does not count
    weight_places_m: list[float] = field(default_factory=list)  # declared, along the string
    stiff_sections_m: list[tuple[float, float]] = field(default_factory=list)  # likewise, of pipes
    speed_limits_rad_s: list[float] = field(default_factory=list)  # in the order of the motion's joints
    play_command: str | None = None  # plays the next motion
    settings: dict[str, Any] = field(default_factory=dict)  # the experiment's, as plain nested data

    def flat_settings(self) -> list[tuple[str, str]]:
        """Return the settings as dotted names and texts, in the order of the file."""
        return list(_flat("", self.settings))


def _flat(prefix: str, node: Any) -> list[tuple[str, str]]:
    if isinstance(node, dict) and node:
        return [pair for key, value in node.items() for pair in _flat(f"{prefix}{key}.", value)]
    return [(prefix.removesuffix("."), "–" if node is None else str(node))]
