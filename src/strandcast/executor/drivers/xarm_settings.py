"""Settings of the xArm driver: `[driver.settings]` of the arm's file."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field


class XArmSettings(BaseModel):
    """The keys of `[driver.settings]` for an xArm.

    Attributes
    ----------
    host
        The control box's IPv4 address; no default. A dry run does not need it.
    joints
        The controller's joints from the base on, by their names in the URDF: five, six or seven.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    host: Annotated[str, Field(pattern=r"^(\d{1,3}(\.\d{1,3}){3})?$")]
    joints: Annotated[list[str], Field(min_length=5, max_length=7)] = [f"joint{j}" for j in range(1, 7)]
