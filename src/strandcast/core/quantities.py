"""Ranges that several settings share."""

from typing import Annotated

from pydantic import Field

Length = Annotated[float, Field(gt=0, le=5)]
Place = Annotated[float, Field(ge=0, le=5)]
Position = Annotated[float, Field(ge=-10, le=10)]
Pixel = Annotated[int, Field(ge=0, le=65535)]
Trial = Annotated[int, Field(ge=1, le=98)]
