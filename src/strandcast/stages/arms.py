"""The arm of an experiment, which throws where its target is: in a plane or in space."""

from strandcast.arm.load import Arm, load_arm
from strandcast.errors import StrandcastError
from strandcast.stages.context import Context

COORDINATES = {2: "x and y", 3: "x, y and z"}


def arm_of(context: Context) -> Arm:
    """Read the experiment's arm.

    Raises
    ------
    StrandcastError
        SC-F014 the target has other coordinates than the arm throws in.
    """
    arm, target_m = load_arm(context.arm_file), context.settings.target_m
    if target_m is not None and len(target_m) != arm.axes:
        where = "space" if arm.axes == 3 else "a plane"
        wanted = COORDINATES[arm.axes]
        what = f"the target has {COORDINATES[len(target_m)]}, and the arm {arm.name!r} throws in {where}"
        fix = f"give the target {wanted}, or another arm"
        raise StrandcastError("SC-F014", what, file=context.file, field="target_m", fix=fix)
    return arm
