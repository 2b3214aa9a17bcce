"""`track:` the tracker."""

from typing import Annotated, Literal

from pydantic import Field

from strandcast.config.camera import Below
from strandcast.core.section import Section

CHAIN = "chain"  # the tracker that needs markers in the plane


class TrackSettings(Section):
    """The tracker and its few settings; those left out are estimated from the video and recorded."""

    tracker: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]{0,40}$")] = Field(
        CHAIN,
        description="chain: markers on the hand and a string; or an installed one. Change it for a "
        "tracker of your own.",
    )
    background_picture: Below | None = Field(
        None,
        description="Picture of the empty scene from the same camera; by default a median over frames. "
        "Give it if the arm stands still for most of the video.",
    )
    polarity: Literal["auto", "bright", "dark"] = Field(
        "auto",
        description="String brighter or darker than the background. Set it if the preview shows that auto"
        " is wrong.",
    )
    contrast_grey: Annotated[float, Field(gt=0, le=65535)] | None = Field(
        None,
        description="Grey levels between a clear piece of string and the background; by default "
        "estimated. Raise it if the tracker follows shadows; lower it if it loses the string.",
    )
