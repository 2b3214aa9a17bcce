"""An ArUco marker on the hand."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import ConfigDict, Field


@dataclass(frozen=True)
class HandMarker:
    """An ArUco marker on the hand.

    The hand's frame has its origin where the string leaves the clamp, and x along the string as clamped.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", allow_inf_nan=False)

    id: Annotated[int, Field(ge=0)]  # in the dictionary
    size_m: Annotated[float, Field(gt=0)]  # side of the black square
    place_m: tuple[float, float]  # (x, y) of its centre in the hand's frame
    angle_rad: float = 0.0  # of its own x axis in the hand's frame
    offset_m: float = 0.0  # height above the plane of motion, towards the camera
