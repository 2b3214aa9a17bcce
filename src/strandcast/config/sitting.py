"""`sitting:` what a sitting at the rig (`strandcast throw`) runs and waits for."""

from __future__ import annotations

import shlex
from typing import Annotated

from pydantic import AfterValidator, Field

from strandcast.core.section import Section


def _words(line: str) -> str:
    """Return a command line that can be split into words."""
    shlex.split(line)
    return line


Program = Annotated[str, Field(min_length=1, max_length=1000), AfterValidator(_words)]


class SittingSettings(Section):
    """Programs and folder of a sitting at the rig."""

    folder: Annotated[str, Field(min_length=1, max_length=1000)] | None = Field(
        None,
        description="Folder in which films, and the logs of an arm without a driver, arrive. Leave it out to "
        "put them into data/NAME/trial-NN/ yourself.",
    )
    before: Program | None = Field(
        None,
        description="Program that runs before each throw; in it, `{trial}` is its number, `{motion}` its "
        "motion.json, `{data}` its folder of raw files. Use it to arm the camera.",
    )
    after: Program | None = Field(
        None,
        description="Program that runs after each throw, once its log is there. Use it to fetch the film.",
    )
    wait_s: Annotated[float, Field(gt=0, le=86400)] = Field(
        600.0,
        description="How long a program may take, and a film to come. Raise it for a slow camera.",
    )
