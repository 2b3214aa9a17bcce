"""What the pages tell that no result holds: plain values from the experiment's and the arm's files."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Facts:
    """Plain values that the caller knows.

    Attributes
    ----------
    title
        The experiment's title, for people.
    hit_radius_m
        Within which a tip counts as a hit [m].
    aims_m
        Where a throw other than at a point is to go: a bar's two ends, a shape's places; none of a swing.
        None: at the motion's target.
    excluded
        Trial -> why it does not count.
    weight_places_m, stiff_sections_m
        Where weights and pipes truly are along the string [m].
    speed_limits_rad_s
        Of the joints that move, in the order of the motion's joints.
    play_command
        The exact command that plays the next motion.
    settings
        The experiment's settings as plain nested data.
    software
        Name -> version.
    """

    title: str = ""
    hit_radius_m: float = 0.02
    aims_m: list[tuple[float, float]] | None = None
    excluded: dict[int, str] = field(default_factory=dict)
    weight_places_m: list[float] = field(default_factory=list)
    stiff_sections_m: list[tuple[float, float]] = field(default_factory=list)
    speed_limits_rad_s: list[float] = field(default_factory=list)
    play_command: str | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    software: dict[str, str] = field(default_factory=dict)

    def flat_settings(self) -> list[tuple[str, str]]:
        """Return the settings as dotted names and texts, in the order of the file."""
        return list(_flat("", self.settings))


def _flat(prefix: str, node: Any) -> list[tuple[str, str]]:
    if isinstance(node, dict) and node:
        return [pair for key, value in node.items() for pair in _flat(f"{prefix}{key}.", value)]
    return [(prefix.removesuffix("."), "–" if node is None else str(node))]
