"""`string:` the properties of the string that are known before it is thrown."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from strandcast.core.quantities import Length, Place
from strandcast.core.section import Section

SPACING_M = 0.03  # between mass points if `points` is not given (chosen; about 10 points for 0.3 m)


class Weight(Section):
    """A weight at a known position on the string."""

    place_m: Place = Field(description="Distance of the weight's middle from the clamp along the string.")
    mass_kg: Annotated[float, Field(gt=0, le=1)] | None = Field(
        None,
        description="Mass of the lab's weight. Leave it out for a real string.",
    )


class StiffSection(Section):
    """A section of the string that does not bend, e.g. a pipe."""

    from_m: Place = Field(description="Start, from the clamp along the string.")
    to_m: Place = Field(description="End, from the clamp along the string.")


class String(Section):
    """Properties of the string that are known before it is thrown."""

    length_m: Length = Field(
        description="Length, including the part in the clamp. Measure it to a millimetre."
    )
    points: Annotated[int, Field(ge=2, le=100)] | None = Field(
        None,
        description="Number of free mass points; by default one per 30 mm, in space 14 of a thrown "
        "string and 20 of a captured one. Raise it for sharp bends "
        "(slower); lower it for a string that barely bends.",
    )
    weights: list[Weight] = Field([], description="Weights on the string; their masses are fitted.")
    stiff_sections: list[StiffSection] = Field(
        [],
        description="Sections that do not bend, e.g. pipes, if longer than a few centimetres.",
    )
    mass_per_length_kg_m: Annotated[float, Field(gt=0, le=10)] | None = Field(
        None,
        description="Mass per length of the bare string. Give it to have fitted weights in kilograms.",
    )
    thickness_m: Annotated[float, Field(gt=0, le=0.05)] | None = Field(
        None,
        description="Thickness in the picture; by default estimated. Set it if the preview shows another "
        "width or string.",
    )

    @property
    def n(self) -> int:
        """Return the number of free mass points."""
        return self.points if self.points is not None else max(2, round(self.length_m / SPACING_M))

    @model_validator(mode="after")
    def _positions_within_string(self) -> String:
        places = [w.place_m for w in self.weights] + [s.to_m for s in self.stiff_sections]
        if any(place > self.length_m + 1e-9 for place in places):
            raise ValueError(f"a weight or stiff section lies beyond the string's {self.length_m} m")
        if any(s.from_m >= s.to_m for s in self.stiff_sections):
            raise ValueError("a stiff section's from_m must be less than its to_m")
        return self
