"""A box in the plane of the throw."""

from __future__ import annotations

from pydantic import Field, model_validator

from strandcast.core.quantities import Position
from strandcast.core.section import Section


class Box(Section):
    """Limits of the places that hand and string may reach, and of the camera's view."""

    x_m: tuple[Position, Position] = Field(description="Least and greatest x in the world frame.")
    y_m: tuple[Position, Position] = Field(description="Least and greatest y in the world frame.")

    @model_validator(mode="after")
    def _lower_bound_first(self) -> Box:
        if self.x_m[0] >= self.x_m[1] or self.y_m[0] >= self.y_m[1]:
            raise ValueError("x_m and y_m must be [least, greatest]")
        return self
