"""An ArUco marker on the hand."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import ConfigDict, Field


@dataclass(frozen=True)
class HandMarker:
    """An ArUco marker on the hand.

    Attributes
    ----------
    id
        Its number in the dictionary.
    size_m
        Side of the black square [m].
    place_m
        (x, y) of its centre in the hand's frame [m]: origin where the string leaves the clamp, x along the
        string as clamped.
    angle_rad
        Direction of its own x axis in the hand's frame [rad].
    offset_m
        Height above the plane of motion, towards the camera [m].
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", allow_inf_nan=False)

    id: Annotated[int, Field(ge=0)]
    size_m: Annotated[float, Field(gt=0)]
    place_m: tuple[float, float]
    angle_rad: float = 0.0
    offset_m: float = 0.0
