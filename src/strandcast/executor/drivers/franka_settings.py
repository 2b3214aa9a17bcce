"""Settings of the Franka driver: `[driver.settings]` of the arm's file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

JOINTS = 7
Positive = Annotated[float, Field(gt=0)]
Seven = Annotated[list[Positive], Field(min_length=JOINTS, max_length=JOINTS)]
Six = Annotated[list[Positive], Field(min_length=6, max_length=6)]
Three = Annotated[list[float], Field(min_length=3, max_length=3)]


class FrankaSettings(BaseModel):
    """The keys of `[driver.settings]` for a Franka arm.

    Attributes
    ----------
    host
        The controller's address; no default. A dry run does not need it.
    realtime
        "enforce": refuse a kernel without real-time scheduling; "ignore": for simulators.
    joints
        The controller's seven joints, by their names in the URDF.
    torque_threshold_n_m, force_threshold_n
        Collision behaviour: the controller stops the arm beyond these; by default as set in Desk.
    load_inertia_kg_m2
        (Ixx, Iyy, Izz) of the payload about its centre.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    host: str
    realtime: Literal["enforce", "ignore"] = "enforce"
    joints: Annotated[list[str], Field(min_length=JOINTS, max_length=JOINTS)] = [
        f"fr3_joint{j}" for j in range(1, JOINTS + 1)
    ]
    torque_threshold_n_m: Seven | None = None
    force_threshold_n: Six | None = None
    load_inertia_kg_m2: Three = [1e-5, 1e-5, 1e-5]

    @model_validator(mode="after")
    def _both_thresholds(self) -> FrankaSettings:
        if (self.torque_threshold_n_m is None) != (self.force_threshold_n is None):
            raise ValueError("set torque_threshold_n_m and force_threshold_n together, or neither")
        return self
