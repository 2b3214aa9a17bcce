"""A cable in space, held at one end or both: at most ten unknowns, fitted to some series to predict others.

All ranges scale with the cable's length, and nothing is specific to a data set.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import medfilt, savgol_filter
from scipy.stats import qmc

from strandcast.core.strings import PARAMETERS, StringBatch
from strandcast.dynamics.batch import HANGING_AT_REST, HandPath, StringStart
from strandcast.dynamics.masses import MassLayout
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import GRAVITY_M_S2, Array
from strandcast.dynamics.simulate import simulate_batch
from strandcast.dynamics.spatial.clamps import POSE
from strandcast.estimation.descent import GaussNewtonModel, apart, descend, descent_batch
from strandcast.estimation.fit_objective import EvaluationLog, FitObjective
from strandcast.estimation.space import Space
from strandcast.estimation.throws import PreparedThrow

# All chosen.
POINTS, STEP_S = 20, 2e-3
SMOOTHING_S = 0.07  # of the clamps: their markers' noise would shake the cable
GLITCH_M_S = 5.0  # faster jumps of a vertex are marker errors
STRAIN = 1e-3  # by the cable's own weight: it does not visibly stretch
STRETCH_DAMPING = 0.1  # of the critical damping of one segment
AIR_LINEAR = 1e-6  # drag is quadratic
FEWEST = 4  # vertices of a shape
SCREENED, DESCENTS, EVALUATIONS, SEED = 64, 3, 350, 1
WINDOWS, WINDOW_S = 20, 2.0  # of motion that are fitted
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)
SCREENING_FRAMES = 60  # of each series

# Unknowns: length over which the cable's weight bends it, over its length; bending damping over stiffness
# [s]; quadratic drag over mass, times the length; stiffness of the clamps over that of half a segment;
# relative change of the length; turns of the clamps [rad]; rest curl, as the turn over the length [rad].
COMMON = {
    "bending_length": (0.01, 3.0),
    "damping_s": (1e-3, 1.0),
    "air": (1e-3, 3.0),
    "clamp_stiffness": (0.02, 50.0),
    "length_change": (-0.08, 0.04),
    "clamp_left_rad": (-0.8, 0.8),
    "clamp_up_rad": (-0.8, 0.8),
}
TWO_ENDS = {"far_left_rad": (-0.8, 0.8), "far_up_rad": (-0.8, 0.8)}
ONE_END = {"curl_left_rad": (-3.0, 3.0), "curl_up_rad": (-3.0, 3.0)}  # both ends held: hardly observable


@dataclass(frozen=True, eq=False)
class CableSeries:
    """One recorded motion of a cable.

    Attributes
    ----------
    time_s
        (F,).
    pose
        (F, 9 or 18) of one clamp or two, see `strandcast.dynamics.batch.HandPath`.
    vertices_m, places
        (F, m, 3) measured positions, and (m,) their places from the first clamp, 0 to 1; NaN where not seen.
    """

    time_s: Array
    pose: Array
    vertices_m: Array
    places: Array

    def two_ends(self) -> bool:
        """Whether the last vertex is held by a clamp, too."""
        return bool(self.pose.shape[1] > POSE)

    def part(self, first: int, last: int) -> CableSeries:
        """Return the frames `first` to before `last`."""
        kept = slice(first, last)
        return replace(self, time_s=self.time_s[kept], pose=self.pose[kept], vertices_m=self.vertices_m[kept])

    def reliable(self) -> np.ndarray:
        """(F, m) whether a vertex is seen, and did not jump on its way there or from there."""
        jump = np.linalg.norm(np.diff(self.vertices_m, axis=0), axis=2) / np.diff(self.time_s)[:, None]
        calm = jump <= GLITCH_M_S
        return np.vstack([calm[:1], calm[1:] & calm[:-1], calm[-1:]])


@dataclass(frozen=True, eq=False)
class CableSpace(Space):
    """Box of a cable's unknowns, by the names above; its strings have bending h and sh the same."""

    length_m: float = 1.0

    def strings(self, chi: Array) -> StringBatch:
        """Candidate cables of exponents (B, d)."""
        value = dict(zip(self.names, self.values(np.atleast_2d(chi)).T, strict=True))
        count, n, l0 = len(np.atleast_2d(chi)), self.layout.shares.shape[1], self.spacing_m
        bending = GRAVITY_M_S2 * (value["bending_length"] * self.length_m) ** 3 / l0**2
        damping = value["damping_s"] * bending
        stretch = n * GRAVITY_M_S2 / (STRAIN * l0)
        columns = {
            "k_s": stretch,
            "c_s": STRETCH_DAMPING * 2.0 * np.sqrt(stretch),
            "k_h": bending,
            "c_h": damping,
            "k_sh": bending,
            "c_sh": damping,
            "C_c1": AIR_LINEAR,
            "C_c2": value["air"] / self.length_m,
            "k_ph": 2.0 * value["clamp_stiffness"] * bending,
            "c_ph": 2.0 * value["clamp_stiffness"] * damping,
        }
        none = np.zeros(count)
        pairs = {
            name: np.column_stack([value.get(f"{name}_{side}_rad", none) for side in ("left", "up")])
            for name in ("clamp", "far", "curl")
        }
        masses = np.ones((count, n))
        masses[:, -1] = 0.5  # of a free end: each point carries half of both its segments
        return StringBatch(
            np.column_stack([np.broadcast_to(columns[name], count) for name in PARAMETERS]),
            masses,
            rest_curl_rad_m=pairs["curl"] / self.length_m,
            clamp_offset_rad=pairs["clamp"],
            far_offset_rad=pairs["far"],
            length_change=value["length_change"],
        )


@dataclass(frozen=True, eq=False)
class CableFit:
    """A fitted cable: the model, its unknowns, and the value of the fit [m]."""

    model: StringModel
    space: CableSpace
    chi: Array
    value_m: float
    evaluations: int

    def values(self) -> dict[str, float]:
        """Return the unknowns by name."""
        found = self.space.values(self.chi)
        return {name: float(value) for name, value in zip(self.space.names, found, strict=True)}

    def predict(self, series: CableSeries) -> Array:
        """Return all vertices (F, m, 3) [m] of a series, open loop from its first frame."""
        hand, strings = HandPath(series.time_s, series.pose), self.space.strings(self.chi)
        points, _ = simulate_batch(self.model, strings, hand, series.time_s, start_of(series, self.model))
        along = np.linspace(0.0, 1.0, self.model.points + 1)
        return np.asarray(CubicSpline(along, points[0], axis=1)(series.places))


def space_of_cable(length_m: float, two_ends: bool) -> tuple[StringModel, CableSpace]:
    """Return the model of a cable of this nominal length [m], and the box of its unknowns."""
    model = StringModel(length_m, POINTS, reading="strain", dt_s=STEP_S)
    unknowns = COMMON | (TWO_ENDS if two_ends else ONE_END)
    return model, CableSpace(
        tuple(unknowns),
        np.array(list(unknowns.values())),
        MassLayout(np.zeros((0, POINTS)), np.zeros(0)),
        np.full(len(unknowns), np.inf),
        model.spacing_m,
        length_m,
    )


def fit_cable(series: list[CableSeries], length_m: float) -> CableFit:
    """Fit a cable to series: screening, then descents from the best that are apart from each other.

    Parameters
    ----------
    series
        The motions to fit.
    length_m
        Nominal free length [m].
    """
    model, space = space_of_cable(length_m, series[0].two_ends())
    throws = tuple(prepared(each, model) for each in windows(series))
    shares = np.full(len(throws), 1.0 / len(throws))
    objective = FitObjective(model, space, throws, shares, 0.0, "world", True)
    log = EvaluationLog(objective.cost)
    # Turns and curls start near zero, where clamps and cables are made to be.
    draw = qmc.Sobol(space.dimension, rng=np.random.default_rng(SEED)).random(SCREENED)
    linear = space.is_linear()
    draw[:, linear] = space.exponents(np.where(linear, 0.0, 1.0))[linear]
    values = EvaluationLog(objective.thinned(SCREENING_FRAMES).cost)(draw)
    chosen = apart(draw, values, DESCENTS)
    starts = draw[chosen]
    descents = descent_batch(starts, log(starts))
    descend(log, GaussNewtonModel(objective), descents, EVALUATIONS)
    chi, value = log.best()
    return CableFit(model, space, chi, value, log.count + SCREENED)


def windows(series: list[CableSeries]) -> list[CableSeries]:
    """Return `WINDOWS` parts of the series, of `WINDOW_S` at most, evenly over series and time.

    Over many seconds, errors of wild motions grow until they say nothing about the cable.
    """
    parts = []
    for k in range(WINDOWS):
        each = series[k * len(series) // WINDOWS if len(series) >= WINDOWS else k % len(series)]
        frames = round(WINDOW_S / float(np.median(np.diff(each.time_s)))) + 1
        first = int(_GOLDEN * k % 1.0 * max(len(each.time_s) - frames, 0))
        steady: np.ndarray = np.all(each.reliable()[first:], axis=1)
        first += int(np.argmax(steady[:-1] & steady[1:])) if len(steady) > frames else 0
        parts.append(each.part(first, first + frames))
    return parts


def prepared(series: CableSeries, model: StringModel) -> PreparedThrow:
    """Return a series as the fit takes it: its vertices interpolated at the model's points."""
    along = np.linspace(0.0, 1.0, model.points + 1)
    reliable = series.reliable()
    points = np.full((len(series.time_s), model.points + 1, 3), np.nan)
    weight = np.zeros((len(series.time_s), model.points))
    for k, seen in enumerate(reliable):
        if seen.sum() < FEWEST:
            continue
        spline = CubicSpline(series.places[seen], series.vertices_m[k, seen], extrapolate=False)
        points[k] = spline(along)
        weight[k] = ~np.isnan(points[k, 1:, 0])
    if series.two_ends():
        weight[:, -1] = 0.0
    return PreparedThrow(
        np.arange(len(series.time_s)),
        series.time_s,
        points,
        weight,
        HandPath(series.time_s, series.pose),
        start_of(series, model),
    )


def start_of(series: CableSeries, model: StringModel) -> StringStart:
    """Return the first frame's shape and the velocity to the second; hanging if few vertices are seen."""
    seen = ~np.isnan(series.vertices_m[:2, :, 0]).any(axis=0)
    if seen.sum() < FEWEST:
        return HANGING_AT_REST
    first, second = CubicSpline(series.places[seen], series.vertices_m[:2, seen], axis=1)(
        np.linspace(0.0, 1.0, model.points + 1)[1:]
    )
    velocity = (second - first) / (series.time_s[1] - series.time_s[0])
    return StringStart(first, velocity, respace=False)


def smoothed(time_s: Array, path: Array) -> Array:
    """Return paths (F, ...) without single wrong samples and with little noise."""
    frames = max(round(SMOOTHING_S / float(np.median(np.diff(time_s)))) // 2 * 2 + 1, 5)
    flat = path.reshape(len(path), -1)
    clean = np.column_stack([medfilt(np.pad(column, 2, mode="edge"), 5)[2:-2] for column in flat.T])
    return np.asarray(savgol_filter(clean, frames, 2, axis=0).reshape(path.shape))
