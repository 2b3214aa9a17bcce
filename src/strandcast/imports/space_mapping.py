"""Column mappings of captures in space: axes, driven ends and markers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from strandcast.errors import StrandcastError
from strandcast.imports.mapping import (
    CaptureMapping,
    CaptureUnits,
    Mapping,
    check_mapping,
    mapping_data,
)


def _three_or_one(names: list[str]) -> list[str]:
    if len(names) not in (1, 3):
        raise ValueError("name three columns, x, y, z, or one name for NAME.x, NAME.y, NAME.z")
    return names


UpAxis = Literal["x", "y", "z", "-x", "-y", "-z"]
Coordinates = Annotated[list[str], AfterValidator(_three_or_one)]
Vector = tuple[float, float, float]


class DrivenBody(Mapping):
    """A body that holds an end of the string: a pose, two points, or one point."""

    position: Coordinates = Field(
        description="Columns x, y, z of where the string leaves it, or one name for NAME.x, NAME.y, NAME.z."
    )
    behind: Coordinates | None = Field(
        None, description="… of a second point, behind it: the string leaves in the direction from there."
    )
    quaternion: list[str] | None = Field(
        None,
        description="Columns w, x, y, z of the body's orientation, or one name for NAME.qw to NAME.qz.",
    )
    leaves: Vector | None = Field(
        None, description="Direction in which the string leaves, in the body's own axes; with `quaternion`."
    )
    offset: Vector = Field(
        (0.0, 0.0, 0.0),
        description="From `position` to where the string leaves, in the body's own axes and `length_unit`; "
        "with `quaternion`.",
    )

    @model_validator(mode="after")
    def _has_one_orientation(self) -> Self:
        if self.behind is not None and self.quaternion is not None:
            raise ValueError("give behind, or quaternion and leaves, not both")
        if self.quaternion is not None and len(self.quaternion) not in (1, 4):
            raise ValueError("name four columns of the quaternion, w, x, y, z, or one body")
        if (self.quaternion is None) != (self.leaves is None):
            raise ValueError("quaternion and leaves (the direction in which the string leaves) go together")
        if self.leaves is not None and not np.any(self.leaves):
            raise ValueError("leaves is a direction, e.g. [0, 0, -1]")
        return self


class SpaceMarker(Mapping):
    """A marker on the string: its place along the free string, and the columns of its position."""

    place_m: float = Field(ge=0, le=20, description="Distance from the first driven end along the string.")
    position: Coordinates = Field(
        description="Columns x, y, z, or one name for NAME.x, NAME.y, NAME.z (a point of a C3D file)."
    )


class SpaceMapping(CaptureUnits):
    """The columns of a capture in space: one driven end or two, and the markers on the string."""

    up: UpAxis | None = Field(None, description="The file's axis that points up, if it does not say so.")
    handedness: Literal["right", "left"] = Field(
        "right", description="left: the file's axes are mirrored, as some animation programs write them."
    )
    hand: DrivenBody | None = Field(
        None, description="The body that holds the string; of an arm's throw, any place on its hand."
    )
    far: DrivenBody | None = Field(None, description="The body at the string's other end, if it is driven.")
    markers: list[SpaceMarker] = Field(min_length=1)

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.time is not None and self.rate_hz is not None:
            raise ValueError("give time or rate_hz, not both")
        bodies = self.bodies()
        if self.far is not None and self.hand is None:
            raise ValueError("far is the second body: give hand, too")
        if len({body.behind is None and body.quaternion is None for body in bodies}) > 1:
            raise ValueError("hand and far both need a direction, or both are only a point")
        return self

    def bodies(self) -> list[DrivenBody]:
        """Return the driven bodies, that at the string's beginning first."""
        return [body for body in (self.hand, self.far) if body is not None]

    def to_world(self) -> np.ndarray:
        """Return the matrix (3, 3) from the file's axes to x, y, z with z up, right-handed."""
        up = self.up or "z"
        k, sign = "xyz".index(up[-1]), -1.0 if up.startswith("-") else 1.0
        matrix = np.zeros((3, 3))
        # The first axis that is not up stays x, so that a file with z up is taken as it is.
        others = [axis for axis in range(3) if axis != k]
        matrix[0, others[0]], matrix[1, others[1]], matrix[2, k] = 1.0, 1.0, sign
        right = np.linalg.det(matrix) > 0
        matrix[1] *= 1.0 if right == (self.handedness == "right") else -1.0
        return matrix


def columns_of(names: list[str]) -> list[str]:
    """Return the three columns of a position that may be given by one name."""
    return [f"{names[0]}.{axis}" for axis in "xyz"] if len(names) == 1 else names


def space_mapping_of(hand: str | None, markers: list[str], **more: Any) -> SpaceMapping:
    """Return a mapping from command-line arguments.

    Parameters
    ----------
    hand
        Columns ``X,Y,Z``, or ``NAME``; None: no body is tracked.
    markers
        One ``PLACE:X,Y,Z`` or ``PLACE:NAME`` each.
    more
        Further fields of `SpaceMapping`; of ``behind``, ``far`` and ``far_behind``, the columns as in `hand`.
    """
    bodies: dict[str, dict[str, list[str]]] = {} if hand is None else {"hand": {"position": _names(hand)}}
    if more.get("far"):
        bodies["far"] = {"position": _names(more["far"])}
    for body, option in (("hand", "behind"), ("far", "far_behind")):
        if more.get(option):
            bodies.setdefault(body, {})["behind"] = _names(more[option])
    given = {name: value for name, value in more.items() if name in SpaceMapping.model_fields and value}
    return check_mapping(given | bodies | {"markers": [_marker(each) for each in markers]}, SpaceMapping)


def load_capture_mapping(path: str | Path) -> CaptureMapping | SpaceMapping:
    """Read the mapping of a capture; in the plane it has `hand_x`, `hand_y`, in space perhaps `hand`."""
    data = mapping_data(path)
    in_space = isinstance(data, dict) and not any(str(key).startswith("hand_") for key in data)
    if in_space:
        return check_mapping(data, SpaceMapping, Path(path))
    return check_mapping(data, CaptureMapping, Path(path))


def _names(words: str) -> list[str]:
    return [name.strip() for name in words.split(",")]


def _marker(words: str) -> dict[str, Any]:
    place, colon, columns = words.partition(":")
    if not colon or len(_names(columns)) not in (1, 3):
        raise StrandcastError(
            "SC-I012", f"{words!r} is not PLACE:X,Y,Z", field="marker", fix="e.g. 0.2:x_mid,y_mid,z_mid"
        )
    return {"place_m": place, "position": _names(columns)}
