"""Ranges that several settings share."""

from typing import Annotated

from pydantic import Field

from strandcast.core.trial_names import LAST_TRIAL

Length = Annotated[float, Field(gt=0, le=5)]
Place = Annotated[float, Field(ge=0, le=5)]
Position = Annotated[float, Field(ge=-10, le=10)]
Pixel = Annotated[int, Field(ge=0, le=65535)]
Trial = Annotated[int, Field(ge=1, le=LAST_TRIAL)]


def value_and_sd(given: float | tuple[float, float], usual_sd: float) -> tuple[float, float]:
    """Return a value with its standard deviation; of a value alone, the usual one."""
    return given if isinstance(given, tuple) else (given, usual_sd)
