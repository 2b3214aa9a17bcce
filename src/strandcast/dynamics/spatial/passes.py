"""One run of all candidates in space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from strandcast.dynamics.candidates import HANGING, SETTLED
from strandcast.dynamics.elements import DRAG_ALONG, DRY, GRAVITY, HALF_WIDTH, STICK
from strandcast.dynamics.model import READINGS
from strandcast.dynamics.observe import RESULTS, SHORTEST
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.spatial.clamps import CLAMP, POSE, drive_clamps
from strandcast.dynamics.spatial.integrate import SpatialStrings, integrate_in_space, spatial_workspace
from strandcast.dynamics.spatial.rest_shape import rest_shapes
from strandcast.dynamics.spatial.step import SpatialSettings
from strandcast.dynamics.spatial.strings import REST_TURN, spatial_coefficients, starts
from strandcast.dynamics.vectors import VectorSpec
from strandcast.threads import over_ranges

if TYPE_CHECKING:
    from strandcast.dynamics.batch import Batch

NO_LENGTH_M = -1.0  # the shortest segment of a string for which no rest shape was found


def pass_in_space(batch: Batch, finer: int, spec: VectorSpec) -> Array:
    """Run candidates once, with steps `finer` times smaller than the model's; return their results.

    Raises
    ------
    ValueError
        For a reading that there is in the plane only.
    """
    model, candidates, hand, start = batch.model, batch.candidates, batch.hand, batch.start
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
        gravity=float(candidates.fixed[0, GRAVITY]),
        reading=READINGS.index(model.reading),
        per_width=float(1.0 / candidates.fixed[0, HALF_WIDTH]),
        has_friction=bool(candidates.fixed[~sticks, DRY].any()),
        slender=bool(candidates.fixed[:, DRAG_ALONG].max() > 0.0),
        two_ends=ends > 1,
        helical=bool(candidates.fixed[:, REST_TURN].any()),
    )
    poses = np.ascontiguousarray(hand.pose[:, 0])
    d, v = starts(candidates, poses, start)
    columns = (candidates.masses, candidates.factor, candidates.shift_m)
    mass, factor, shift = (np.ascontiguousarray(column.T) for column in columns)
    strings = SpatialStrings(spatial_coefficients(candidates, step), mass, factor, d, v, shift)
    lost = np.zeros(len(kept), dtype=bool)
    if start.mode in (HANGING, SETTLED):
        over_ranges(
            len(kept),
            lambda first, last: rest_shapes(first, last, candidates, strings.c, poses, settings, d, lost),
        )
    own = len(hand.pose) > 1
    common = np.empty((1 if own else steps * ends * CLAMP, 1))
    if not own:
        drive_clamps(hand.time_s, hand.pose[0], step, steps, 0, common)
    outputs = batch.outputs._replace(at=batch.outputs.at * finer)

    def run(first: int, last: int) -> None:
        own_rows = steps * ends * CLAMP if own else 0
        work = spatial_workspace(spec, model.points, own_rows, sticks=bool(sticks.any()))
        integrate_in_space(
            first, last, spec, work, strings, (hand.time_s, hand.pose), common, steps, settings, outputs, kept
        )

    over_ranges(-(-len(kept) // spec.width), run)
    kept[lost, SHORTEST] = NO_LENGTH_M
    return kept
