"""One run of all candidates in space."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from strandcast.dynamics.candidates import HANGING, SETTLED
from strandcast.dynamics.elements import DRAG_ALONG, DRY, GRAVITY, HALF_WIDTH, STICK
from strandcast.dynamics.model import READINGS
from strandcast.dynamics.observe import RESULTS
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.spatial.clamps import CLAMP, POSE, drive_clamps
from strandcast.dynamics.spatial.integrate import SpatialStrings, integrate_in_space, spatial_workspace
from strandcast.dynamics.spatial.step import SpatialSettings
from strandcast.dynamics.spatial.strings import REST_TURN, spatial_coefficients, starts
from strandcast.dynamics.vectors import VectorSpec
from strandcast.threads import over_ranges

if TYPE_CHECKING:
    from strandcast.dynamics.batch import Batch


def pass_in_space(batch: Batch, finer: int, spec: VectorSpec) -> Array:
    """Run candidates once, with steps `finer` times smaller than the model's; return their results.

    Raises
    ------
    ValueError
        For a scheme or a reading that there is in the plane only.
    """
    model, candidates, hand, start = batch.model, batch.candidates, batch.hand, batch.start
    if model.integrator != "lfcn":
        raise ValueError(f"strings in space are integrated by lfcn, not by {model.integrator}")
    p = candidates.parameters
    if model.reading == "sign" and (p[:, [2, 3]] != p[:, [4, 5]]).any():
        raise ValueError("a bend in space has no sign: h and sh are the same, or the reading is another")
    kept = np.empty((len(candidates.masses), RESULTS))
    if not len(kept):
        return kept
    step, steps, ends = model.dt_s / finer, batch.steps * finer, hand.pose.shape[2] // POSE
    sticks = candidates.fixed[:, STICK] > 0.0
    settings = SpatialSettings(
        step=step,
        kick=step,
        fine=0.0,
        coarse=0.0,
        half=0.0,
        floor=1.0,
        gravity=float(candidates.fixed[0, GRAVITY]),
        reading=READINGS.index(model.reading),
        per_width=float(1.0 / candidates.fixed[0, HALF_WIDTH]),
        has_friction=bool(candidates.fixed[~sticks, DRY].any()),
        slender=bool(candidates.fixed[:, DRAG_ALONG].max() > 0.0),
        two_ends=ends > 1,
        helical=bool(candidates.fixed[:, REST_TURN].any()),
    )
    d, v = starts(candidates, np.ascontiguousarray(hand.pose[:, 0]), start)
    columns = (candidates.masses, candidates.factor, candidates.shift_m)
    mass, factor, shift = (np.ascontiguousarray(column.T) for column in columns)
    strings = SpatialStrings(spatial_coefficients(candidates, step), mass, factor, d, v, shift)
    own = len(hand.pose) > 1
    common = np.empty((1 if own else steps * ends * CLAMP, 1))
    if not own:
        drive_clamps(hand.time_s, hand.pose[0], step, steps, 0, common)
    outputs = batch.outputs._replace(at=batch.outputs.at * finer)

    def run(first: int, last: int, spec: VectorSpec, steps: int, settle: bool) -> None:
        own_rows = (steps + settle) * ends * CLAMP if own else 0
        work = spatial_workspace(spec, model.points, own_rows, sticks=bool(sticks.any()) and not settle)
        integrate_in_space(
            first,
            last,
            spec,
            work,
            strings,
            (hand.time_s, hand.pose),
            common,
            steps,
            settings,
            settle,
            outputs,
            kept,
        )

    # The rest shape is sought in double precision: stretch is far stiffer than bending.
    runs = [(spec, steps, False)]
    if start.mode in (HANGING, SETTLED):
        runs.insert(0, (double_of(spec), 0, True))
    for chosen, count, settle in runs:
        over_ranges(
            -(-len(kept) // chosen.width),
            partial(run, spec=chosen, steps=count, settle=settle),
        )
    return kept


def double_of(spec: VectorSpec) -> VectorSpec:
    """Return vectors of double precision in the same registers."""
    return VectorSpec(64, max(spec.width * spec.bits // 64, 1) if spec.width > 1 else 1)
