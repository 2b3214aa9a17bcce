"""The columns of a capture, in the plane of motion or in space: units, axes, driven ends and markers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from strandcast.errors import StrandcastError
from strandcast.imports.mapping import LENGTH_UNITS, AngleUnit, LengthUnit, Mapping, TimeUnit, check_mapping


def _coordinates(names: list[str]) -> list[str]:
    if not 1 <= len(names) <= 3:
        raise ValueError("name two columns in the plane, three in space, or one name for NAME.x, .y, .z")
    return names


UpAxis = Literal["x", "y", "z", "-x", "-y", "-z"]
Coordinates = Annotated[list[str], AfterValidator(_coordinates)]
Vector = tuple[float, float, float]
PLANE, SPACE = 2, 3


def columns_of(names: list[str]) -> list[str]:
    """Return the columns of a position: two, or three, which one name may stand for.

    ``NAME@5`` is the point NAME whose first column is the fifth.
    """
    if len(names) > 1:
        return names
    name, at, first = names[0].rpartition("@")
    if at and first.isdecimal():
        return [f"{name}.{axis}@{int(first) + k}" for k, axis in enumerate("xyz")]
    return [f"{names[0]}.{axis}" for axis in "xyz"]


def at_rest(columns: list[str]) -> np.ndarray | None:
    """Return the coordinates of a place at rest, which numbers with a point are; None for columns."""
    try:
        return np.array(columns, dtype=float) if all("." in column for column in columns) else None
    except ValueError:
        return None


class DrivenBody(Mapping):
    """A body that holds an end of the string: a pose, two points, or one point."""

    position: Coordinates = Field(
        description="Columns of where the string leaves it: x, y; in space x, y, z, or one name for NAME.x, "
        "NAME.y, NAME.z. Numbers with a point (0.0) are a place at rest."
    )
    behind: Coordinates | None = Field(
        None, description="… of a second point, behind it: the string leaves in the direction from there."
    )
    quaternion: list[str] | None = Field(
        None, description="Columns w, x, y, z of the body's orientation, or one name for NAME.qw to NAME.qz."
    )
    euler: list[str] | None = Field(
        None,
        description="Instead of it: columns of three angles in `angle_unit`, or one name for NAME.rx to "
        "NAME.rz.",
    )
    euler_order: str | None = Field(
        None,
        pattern=r"^([xyz]{3}|[XYZ]{3})$",
        description="In which order they turn: XYZ about the body's own axes, xyz about the file's.",
    )
    leaves: Vector | None = Field(
        None, description="Direction in which the string leaves, in the body's own axes; with an orientation."
    )
    offset: Vector = Field(
        (0.0, 0.0, 0.0),
        description="From `position` to where the string leaves, in the body's own axes and `length_unit`; "
        "with an orientation.",
    )

    @property
    def is_turned(self) -> bool:
        """Whether its orientation is measured."""
        return self.quaternion is not None or self.euler is not None

    @model_validator(mode="after")
    def _has_one_orientation(self) -> Self:
        if sum(given is not None for given in (self.behind, self.quaternion, self.euler)) > 1:
            raise ValueError("give one of behind, quaternion and euler")
        if (self.euler is None) != (self.euler_order is None):
            raise ValueError(
                "euler and euler_order (e.g. XYZ) go together: programs order angles differently"
            )
        if self.euler is not None and len(self.euler) not in (1, 3):
            raise ValueError("name three columns of euler, in the order of euler_order, or one body")
        if self.quaternion is not None and len(self.quaternion) not in (1, 4):
            raise ValueError("name four columns of the quaternion, w, x, y, z, or one body")
        if self.is_turned != (self.leaves is not None):
            raise ValueError("an orientation and leaves (in which direction the string leaves) go together")
        if self.leaves is not None and not np.any(self.leaves):
            raise ValueError("leaves is a direction, e.g. [0, 0, -1]")
        return self


class CaptureMarker(Mapping):
    """A marker on the string: its place along the free string, and the columns of its position."""

    place_m: float = Field(ge=0, le=20, description="Distance from the first driven end along the string.")
    position: Coordinates = Field(description="Its columns, as of a body.")
    point: int | None = Field(None, ge=1, description="In the plane: the mass point, if not the nearest.")

    @model_validator(mode="before")
    @classmethod
    def _named_one_by_one(cls, data: Any) -> Any:
        return _joined(data, "position", "x", "y", list)


class CaptureMapping(Mapping):
    """The columns of a capture: one driven end or two, and the markers on the string.

    Two columns of each position are the plane of motion, x to the right and y up; three are space. What is
    not given is the file's own.
    """

    time: str | None = Field(None, description="Column of the time; not needed where the file has a rate.")
    time_unit: TimeUnit = "s"
    rate_hz: float | None = Field(None, gt=0, le=1e6, description="Rows per second, where no column is.")
    length_unit: LengthUnit | None = None
    sigma_m: float = Field(1e-3, gt=0, le=0.1, description="Standard error of a marker's coordinate.")
    up: UpAxis | None = Field(None, description="In space: the axis that points up, if the file names none.")
    handedness: Literal["right", "left"] = Field(
        "right", description="left: the file's axes are mirrored, as some animation programs write them."
    )
    hand: DrivenBody | None = Field(
        None, description="The body that holds the string; of an arm's throw in space, any place on its hand."
    )
    far: DrivenBody | None = Field(None, description="The body at the string's other end, if it is driven.")
    hand_angle: str | None = Field(
        None, description="In the plane: column of the direction in which the string leaves the hand."
    )
    angle_unit: AngleUnit = "rad"
    angle_sign: Literal[-1, 1] = Field(1, description="-1 where the file's angle grows clockwise.")
    angle_offset_rad: float = Field(
        0.0, description="Direction in which the string leaves the hand when the file's angle is zero."
    )
    markers: list[CaptureMarker] = Field(min_length=1)
    motion_start_s: float | None = Field(None, description="By default the first and the last row.")
    motion_end_s: float | None = None

    @model_validator(mode="before")
    @classmethod
    def _hand_one_by_one(cls, data: Any) -> Any:
        return _joined(data, "hand", "hand_x", "hand_y", lambda position: {"position": position})

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        bodies = [body for body in (self.hand, self.far) if body is not None]
        if self.time is not None and self.rate_hz is not None:
            raise ValueError("give time or rate_hz, not both")
        if self.far is not None and self.hand is None:
            raise ValueError("far is the second body: give hand, too")
        if len({body.behind is None and not body.is_turned for body in bodies}) > 1:
            raise ValueError("hand and far both need a direction, or both are only a point")
        if len({len(columns) for columns in self.positions()}) > 1:
            raise ValueError("name as many columns of each body as of the markers: two, or three in space")
        of_space = [name for name in ("up", "far") if getattr(self, name) is not None]
        of_space += ["handedness"] if self.handedness == "left" else []
        of_space += ["an orientation"] if self.hand is not None and self.hand.is_turned else []
        if not self.in_space and of_space:
            raise ValueError(f"two columns are a plane: name three of each body and marker for {of_space[0]}")
        angled = self.hand_angle is not None or self.angle_offset_rad != 0.0 or self.angle_sign != 1
        if angled and (self.in_space or any(body.behind is not None for body in bodies)):
            raise ValueError("an angle is of a hand in the plane; behind, or a quaternion, is its direction")
        if self.in_space and any(marker.point is not None for marker in self.markers):
            raise ValueError("mass points are those of the plane: leave point out")
        return self

    @property
    def in_space(self) -> bool:
        """Whether the markers have three coordinates."""
        return len(columns_of(self.markers[0].position)) == SPACE

    def positions(self) -> list[list[str]]:
        """Return the columns of each marker and body, and of the points behind these."""
        bodies = [body for body in (self.hand, self.far) if body is not None]
        places = [each.position for each in self.markers] + [body.position for body in bodies]
        return [columns_of(each) for each in places + [body.behind for body in bodies if body.behind]]

    def unit_m(self) -> float:
        """Return the unit of lengths [m]; see `capture_table.with_units`."""
        return LENGTH_UNITS[self.length_unit or "m"]

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


def capture_mapping_of(hand: str | None, markers: list[str], **more: Any) -> CaptureMapping:
    """Return a mapping from command-line arguments.

    Parameters
    ----------
    hand
        Columns ``X,Y`` or ``X,Y,ANGLE``, in space ``X,Y,Z`` or ``NAME``; None: ``x,y,angle`` in the plane, no
        body in space.
    markers
        One ``PLACE:X,Y`` each, in space ``PLACE:X,Y,Z`` or ``PLACE:NAME``: the place along the string [m] and
        the columns, e.g. ``0.2:x_mid,z_mid``; ``PLACE@POINT:X,Y`` names the mass point too.
    more
        Further fields of `CaptureMapping`; ``behind``, ``far`` and ``far_behind`` are columns as in `hand`.
    """
    data: dict[str, Any] = {name: value for name, value in more.items() if value is not None}
    data["markers"] = [_marker(each) for each in markers]
    in_plane = all(len(marker["position"]) == PLANE for marker in data["markers"])
    named = {"hand": hand or ("x,y,angle" if in_plane else None), "far": data.pop("far", None)}
    bodies = {body: {"position": _names(words)} for body, words in named.items() if words}
    for body, option in (("hand", "behind"), ("far", "far_behind")):
        if words := data.pop(option, None):
            bodies.setdefault(body, {})["behind"] = _names(words)
    if in_plane and len(bodies.get("hand", {}).get("position", [])) == PLANE + 1:
        data["hand_angle"] = bodies["hand"]["position"].pop()
    return check_mapping(data | bodies, CaptureMapping)


def _joined(data: Any, name: str, x: str, y: str, held: Callable[[list[Any]], Any]) -> Any:
    """Return data in which a position in the plane may be given by two keys, one of each column."""
    if not isinstance(data, dict) or not {x, y} & data.keys():
        return data
    position = held([data.get(x), data.get(y)])
    return {name: position} | {key: value for key, value in data.items() if key not in (x, y)}


def _names(words: str) -> list[str]:
    return [name.strip() for name in words.split(",")]


def _marker(words: str) -> dict[str, Any]:
    place, colon, columns = words.partition(":")
    if not colon:
        what = f"{words!r} is not PLACE:X,Y, PLACE:X,Y,Z or PLACE:NAME"
        raise StrandcastError("SC-I011", what, field="marker", fix="e.g. 0.2:x_mid,z_mid")
    place, _, point = place.partition("@")
    return {"place_m": place, "position": _names(columns)} | ({"point": point} if point else {})
