"""`method: paper`: the paper's method as a whole, and the settings that it alone has."""

from typing import Annotated, Any, Literal

from pydantic import Field

from strandcast.core.section import Section


class PaperSearch(Section):
    """Numbers of eq. 3 that the paper does not print."""

    centre: Literal["fixed", "running"] = Field(
        "running",
        description="Draw around the previous trial's estimate (fixed), or around the best so far (running).",
    )
    chi_0: Annotated[float, Field(gt=0, le=1)] = Field(
        1.0,
        description="Largest first change of a parameter, as a share of its range.",
    )
    beta: Annotated[float, Field(gt=0, lt=1)] = Field(
        0.999,
        description="Factor by which that change shrinks from one change to the next.",
    )


class PaperReading(Section):
    """Reading of section V where its text is ambiguous."""

    altered_from: Literal["executed", "walking"] = Field(
        "executed",
        description="Later tries alter the motion played last, or walk from the nearest try so far.",
    )
    accept: Literal["first_hit", "best"] = Field(
        "first_hit",
        description="Throw the first motion that hits in the simulation, or the nearest of all tries.",
    )
    ends: Literal["ramp", "rest"] = Field(
        "ramp",
        description="A ramp stops the arm after eq. 1's curve, or the curve itself begins and ends at rest.",
    )
    altered_rad_s: Annotated[float, Field(gt=0, le=10)] = Field(
        0.5,
        description="Largest change of a control point's velocity from one try to the next; the paper's "
        "is 0.5.",
    )
    largest_slope_rad_s2: Annotated[float, Field(gt=0, le=10_000)] = Field(
        60.0,
        description="Largest alpha_k in eq. 1, which the paper does not give.",
    )


class PaperFit(Section):
    """Settings of the fit that belong to the paper's method. Change them only to compare."""

    evaluation: Literal["world", "hand"] = Field(
        "world", description="Frame of E: world, or relative to the hand (the paper)."
    )
    reading: Literal["rate", "sign", "strain"] = Field(
        "rate",
        description="Which bends take h and which sh: growing and straightening (rate), left and right "
        "(sign), or compressed and stretched (strain).",
    )
    free_end: bool = Field(
        True,
        description="Give the last point half the others' mass, as it carries half a segment; the paper "
        "does not.",
    )
    joints: Literal["measured", "commanded"] = Field(
        "measured", description="Joint angles that drive the simulated hand."
    )
    paper: PaperSearch = Field(PaperSearch(), description="Readings of eq. 3. Change them only to compare.")


class PaperPlanner(Section):
    """Settings of the planner that belong to the paper's method. Change them only to compare."""

    planner: Literal["ensemble", "paper"] = Field(
        "ensemble", description="Robust planning over the ensemble, or the paper's."
    )
    use_servo: bool | None = Field(
        None, description="Plan with the servo's response; by default not with the paper's planner."
    )
    paper: PaperReading = Field(
        PaperReading(), description="Readings of section V. Change them only to compare."
    )


# Section -> its settings that nothing but `method: paper` takes.
PAPERS: dict[str, type[Section]] = {"estimate": PaperFit, "plan": PaperPlanner}

# What `method: paper` means where the file gives nothing else.
PRESET: dict[str, Any] = {
    "start_string": "minima",  # section VII-A
    "estimate": {
        "search": "paper",  # eq. 3
        "ranges": "paper",  # Table 2; relative masses 1 to 20, by Table 4
        "trials": "latest",  # section VI: the manipulation just made
        "evaluation": "hand",  # section VI: images centred on the grasping point
        "start_shape": "hanging",  # not given: the paper does not mention the string's first shape
        "forces": "paper",  # no such parameters in Table 1
        "free_end": False,  # the paper's plain points are alike
        "horizon_s": None,  # "the total number of images taken": the whole motion
        "joints": "measured",  # section VI: "the profile of each joint angle" is captured
    },
    "plan": {
        "planner": "paper",  # section V
        "duration_s": [0.2, 1.2],  # section V-A
        "screening": 2400,  # motions tried before the best so far is thrown; not given
        "use_servo": False,  # commanded angles: the paper does not mention a servo's response
    },
}


def with_method(data: dict[str, Any]) -> dict[str, Any]:
    """Return plain settings with those of the paper's method, where they ask for it and give no others."""
    if data.get("method") != "paper":
        return data
    sections = {
        name: PRESET[name] | data.get(name, {}) for name in PAPERS if isinstance(data.get(name, {}), dict)
    }
    return PRESET | data | sections
