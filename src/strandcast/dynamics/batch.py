"""The inputs of a simulation, and the contiguous arrays that the kernels take."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from strandcast.core.strings import StringBatch
from strandcast.dynamics.candidates import AS_GIVEN, HANGING, RESPACED, SETTLED, Candidates, StartArrays
from strandcast.dynamics.elements import FIXED
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.observe import Outputs
from strandcast.dynamics.parameters import Array
from strandcast.dynamics.spatial.clamps import POSE
from strandcast.dynamics.spatial.strings import SPATIAL_FIXED, in_space, spatial_columns


class HandPath(NamedTuple):
    """Path of the hand; the simulation starts at its first sample, and the hand rests at the last one.

    Attributes
    ----------
    time_s
        (T,) increasing times [s].
    pose
        (T, 3) x, y [m] and unwrapped angle [rad], or (B, T, 3) for a path of each string's own. In space,
        (T, 9) or (B, T, 9): x, y, z [m], z upwards, the direction in which the clamp holds the string, and a
        normal to it that turns with the clamp (`strandcast.dynamics.spatial.clamps` makes them). (…, 18): the
        same of a second clamp at the string's end, its direction away from that clamp.
    """

    time_s: Array
    pose: Array


class StringStart(NamedTuple):
    """How all strings of a batch start.

    Attributes
    ----------
    points_m
        (n, 2 or 3) positions of points 1…n at the first sample [m]; None: hanging at rest, clamped in the
        hand.
    velocity_m_s
        (n, 2 or 3) velocities [m/s]; None: at rest.
    respace
        Keep only the directions of `points_m`, and give the segments the lengths of a string at rest. Between
        two clamps the lengths are kept.
    settle
        In space, seek each string's own rest shape from `points_m`; velocities belong to that shape.
    """

    points_m: Array | None = None
    velocity_m_s: Array | None = None
    respace: bool = True
    settle: bool = False


HANGING_AT_REST = StringStart()


class MeasuredPoints(NamedTuple):
    """Measured points that simulated strings are compared with.

    Attributes
    ----------
    time_s
        (F,) times [s].
    points_m
        (F, n, 2 or 3) points 1…n [m], anything where their weight is 0.
    per_metre
        (F, n) weights of the distances.
    """

    time_s: Array
    points_m: Array
    per_metre: Array


class Batch(NamedTuple):
    """B candidates and their throw, as `strandcast.dynamics.integrate.integrate` takes them."""

    model: StringModel
    candidates: Candidates
    hand: HandPath
    start: StartArrays
    steps: int
    outputs: Outputs

    def observing(self, **outputs: Any) -> Batch:
        """Return this batch with other outputs."""
        return self._replace(outputs=self.outputs._replace(**outputs))

    def take(self, rows: NDArray[np.int64]) -> Batch:
        """Return the candidates `rows`, with arrays of their own for the positions."""
        hand, out = self.hand, self.outputs.out
        return self._replace(
            candidates=Candidates(*(column[rows] for column in self.candidates)),
            hand=hand if len(hand.pose) == 1 else hand._replace(pose=hand.pose[rows]),
        ).observing(out=out[rows] if len(out) else out)


def make_batch(
    model: StringModel, strings: StringBatch, hand: HandPath, out_time_s: Array, start: StringStart
) -> Batch:
    """Return checked arrays of a simulation with outputs at `out_time_s` (F,) [s] and no observer yet."""
    n, count = model.points, len(strings)
    time_s, pose, out_s = (np.ascontiguousarray(a, dtype=float) for a in (*hand, out_time_s))
    pose = pose[None] if pose.ndim == 2 else pose
    masses = rows_of(strings.masses, count, n)
    at = (out_s - time_s[0]) / model.dt_s
    _check(count, time_s, pose, at)
    spatial = in_space(pose)
    if start.settle and not spatial:
        raise ValueError("strings are settled from a given shape in space only")
    if strings.far_offset_rad.any() and pose.shape[2] <= POSE:
        raise ValueError("only a second clamp has an offset: the path is of one")
    axes = 3 if spatial else 2
    steps = max(int(np.ceil(at[-1] - 1e-9)), 1) if len(at) else 1
    fixed = np.column_stack(
        np.broadcast_arrays(
            model.spacing_m,
            0.0 if spatial else strings.rest_curl_rad_m * model.spacing_m,
            0.0 if spatial else strings.thrown_clamp_offset_rad(),
            model.gravity_m_s2,
            model.switch(),
            strings.bend_friction,
            strings.drag_along,
            *strings.disturbances.sway.T,
            strings.friction_stick_rad_m * model.spacing_m,
        )
    )
    columns = FIXED
    if spatial:
        columns = SPATIAL_FIXED
        fixed = np.hstack([np.broadcast_to(fixed, (count, FIXED)), spatial_columns(strings, model.spacing_m)])
    elif strings.length_change.any() or strings.rest_curl_rad_m.ndim > 1 or strings.rest_torsion_rad_m.any():
        raise ValueError("a string in the plane has one rest curl and the model's length")
    return Batch(
        model,
        Candidates(
            rows_of(strings.parameters, count, 10),
            masses,
            rows_of(strings.bend_factors(), count, n),
            rows_of(fixed, count, columns),
            np.zeros((count, axes)),
        ),
        HandPath(time_s, pose),
        StartArrays(
            _mode(start),
            np.zeros((n, 2) if axes == 2 else (0, 3))
            if start.points_m is None
            else rows_of(start.points_m, n, axes),
            np.zeros((n, axes)) if start.velocity_m_s is None else rows_of(start.velocity_m_s, n, axes),
        ),
        steps,
        Outputs(
            np.clip(at, 0.0, float(steps)),
            np.empty((0, n, axes)),
            np.empty((0, n)),
            np.empty((0, 0, 0, 0)),
        ),
    )


def _mode(start: StringStart) -> int:
    if start.points_m is None:
        return HANGING
    if start.settle:
        return SETTLED
    return RESPACED if start.respace else AS_GIVEN


def rows_of(values: Array, rows: int, columns: int) -> Array:
    """Return `values` as a contiguous array of that shape; the kernels check no bounds."""
    array = np.ascontiguousarray(values, dtype=float)
    if array.shape != (rows, columns):
        raise ValueError(f"expected an array of shape ({rows}, {columns}), got {array.shape}")
    return array


def _check(count: int, time_s: Array, pose: Array, at: Array) -> None:
    if pose.shape[0] not in (1, count) or pose.shape[1:] not in (
        (len(time_s), columns) for columns in (3, 9, 18)
    ):
        raise ValueError(f"{count} candidates and {len(time_s)} times do not fit hand poses {pose.shape}")
    if len(time_s) < 2 or not np.all(np.diff(time_s) > 0):
        raise ValueError("the hand's times must increase")
    if len(at) and (at[0] < -1e-6 or not np.all(np.diff(at) >= 0)):
        raise ValueError("output times must increase and not precede the hand's first sample")
