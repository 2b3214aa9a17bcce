"""Cables moved in space by two robots: fitted to training sequences, predicted open loop on others.

Two predictors without physics are the baseline. Published for such sequences (Chen et al., CoRL 2024, arXiv
2406.05931): a mean coordinate error of some 10 mm over all vertices, the clamped ones included.
"""

import time
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np

from strandcast.config.estimate import EstimateSettings
from strandcast.core.jumps import GLITCH_M_S
from strandcast.dynamics.parameters import Array
from strandcast.estimation.cable_series import CableSeries, series_between
from strandcast.estimation.cable_space import space_of_cable
from strandcast.estimation.estimate import FoundString, find_string
from strandcast.estimation.optimisers.optimiser import SearchStart
from strandcast.estimation.windows import parts_by_roll
from strandcast.records.alignment import EndPath
from strandcast_studies.evidence.figure import Figure

FRAME_S = 0.01
DRIVEN_VERTICES = (0, 1, -2, -1)
PUBLISHED_MM = 9.9
SETTINGS, SEED = EstimateSettings().in_space(thrown=False), 1


class Predictor(Protocol):
    """Predicts a cable's vertices from its start and the motion of its clamped ends."""

    def __call__(self, start_m: Array, ends_m: Array) -> Array:
        """Return vertices (F, n, 3) [m].

        Parameters
        ----------
        start_m
            (2, n, 3) vertices in the first two frames [m], 10 ms apart: shape and velocity.
        ends_m
            (F, 4, 3) driven vertices 0, 1, n-2, n-1 in all frames [m].
        """
        ...


def held(start_m: Array, ends_m: Array) -> Array:
    """Predict that only the clamped ends move."""
    path = np.repeat(start_m[:1], len(ends_m), axis=0)
    path[:, DRIVEN_VERTICES] = ends_m
    return path


def carried(start_m: Array, ends_m: Array) -> Array:
    """Predict that each vertex moves with the ends, interpolated by its place along the cable."""
    first = start_m[0]
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(first, axis=0), axis=1))]
    share = (along / along[-1])[:, None]
    left, right = (ends_m[:, k] - ends_m[0, k] for k in (0, -1))
    path = first + (1.0 - share) * left[:, None] + share * right[:, None]
    path[:, DRIVEN_VERTICES] = ends_m
    return np.asarray(path)


TRIVIAL: dict[str, Predictor] = {"shape_held": held, "carried_by_the_ends": carried}


class FittedCable:
    """Predicts with a fitted string in space."""

    def __init__(self, fit: FoundString, places: Array) -> None:
        self.fit, self.places = fit, places

    def __call__(self, start_m: Array, ends_m: Array) -> Array:
        """Return vertices (F, n, 3) [m]."""
        path = np.full((len(ends_m), start_m.shape[1], 3), np.nan)
        path[:2] = start_m
        path[:, DRIVEN_VERTICES] = ends_m
        series = series_of(path, self.places)[self.fit.roll]
        path[:, 1:-1] = series.predicted(self.fit.objective.model, self.fit.string)
        path[:, DRIVEN_VERTICES] = ends_m
        return path


def places_of(sequences: Array) -> tuple[Array, float]:
    """Return the places (n - 2,) of vertices 1 to n - 2, 0 to 1, and the length between them [m]."""
    segments = np.median(np.linalg.norm(np.diff(sequences[:, :, 1:-1], axis=2), axis=3), axis=(0, 1))
    along = np.r_[0.0, np.cumsum(segments)]
    return along / along[-1], float(along[-1])


def series_of(measured: Array, places: Array) -> dict[str, CableSeries]:
    """Return a sequence (F, n, 3) [m] as a series between two clamps, each of two vertices, by their roll."""
    time_s = np.asarray(FRAME_S * np.arange(len(measured)), dtype=float)
    ends = [
        EndPath(measured[:, inner], measured[:, inner] - measured[:, outer])
        for outer, inner in ((0, 1), (-1, -2))
    ]
    return series_between(time_s, ends, measured[:, 1:-1], places)


def errors_m(predict: Predictor, sequences: Array) -> tuple[float, float]:
    """Return mean errors of open-loop predictions on sequences (S, F, n, 3) [m].

    Vertices that jump faster than `GLITCH_M_S` are not counted.

    Returns
    -------
    coordinate
        Mean absolute coordinate error of all vertices, the driven ones counted as 0: the published measure.
    distance
        Mean distance of the free vertices.
    """
    n = sequences.shape[2]
    free = np.delete(np.arange(n), DRIVEN_VERTICES)
    coordinate, distance = [], []
    for measured in sequences.astype(float):
        miss = (predict(measured[:2], measured[:, DRIVEN_VERTICES]) - measured)[:, free]
        jump = np.linalg.norm(np.diff(measured[:, free], axis=0, prepend=measured[:1, free]), axis=2)
        counted = miss[jump <= GLITCH_M_S * FRAME_S]
        coordinate.append(np.abs(counted).mean(axis=1))
        distance.append(np.linalg.norm(counted, axis=1))
    share = len(free) / n
    return share * float(np.concatenate(coordinate).mean()), float(np.concatenate(distance).mean())


def cables_in(folder: Path) -> list[str]:
    """Return the names of the cables with training and evaluation sequences in a folder."""
    names = sorted(path.name.removesuffix("_eval.npy") for path in folder.glob("*_eval.npy"))
    return [name for name in names if (folder / f"{name}_train.npy").is_file()]


def fitted_on(training: Array, *, friction_stick: bool = False) -> tuple[FittedCable, float]:
    """Fit a cable to training sequences (S, F, n, 3) [m]; return the predictor and its CPU time [s]."""
    before = time.process_time()
    places, length_m = places_of(training.astype(float))
    sequences = [series_of(each, places) for each in training.astype(float)]
    forces = ["rest_curl", "taper"] + ["friction_stick"] * friction_stick
    model, space = space_of_cable(length_m, True, forces=set(forces))
    parts = parts_by_roll(sequences, model.points, last=False)
    random, start = partial(np.random.default_rng, SEED), SearchStart(None, len(sequences))
    fit = find_string(parts, model, space, SETTINGS, random, start)
    return FittedCable(fit, places), time.process_time() - before


def held_out(cable: str, training: Array) -> list[Figure]:
    """Return errors on one half of the training sequences under the fit to the other, both ways.

    The halves are every second sequence; with friction that sticks and without.
    """
    halves = {"even": training[::2], "odd": training[1::2]}
    figures = []
    for fitted, predicted in (("even", "odd"), ("odd", "even")):
        for name, sticks in (("string", False), ("sticks", True)):
            predict, _ = fitted_on(halves[fitted], friction_stick=sticks)
            coordinate, distance = errors_m(predict, halves[predicted])
            detail = {"distance_mm": 1e3 * distance, "fit_m": predict.fit.log.best()[1]}
            note = f"fitted to every second training sequence ({fitted}), {predicted} ones predicted"
            about = f"deform_dlo.held_out.{cable}.{fitted}_to_{predicted}.{name}"
            figures.append(Figure(about, 1e3 * coordinate, "mm", None, note, detail))
    return figures


def sticking(cable: str, training: Array, sequences: Array) -> Figure:
    """Return the error on evaluation sequences of the string fitted with friction that sticks."""
    fitted, _ = fitted_on(training, friction_stick=True)
    coordinate, _ = errors_m(fitted, sequences)
    note = "all vertices, driven ones counted as 0; fitted with friction that sticks"
    about = {"unknowns": fitted.fit.values(), "fit_m": fitted.fit.log.best()[1]}
    return Figure(f"deform_dlo.coordinate.{cable}.sticks", 1e3 * coordinate, "mm", None, note, about)


def predicted(cable: str, training: Array, sequences: Array) -> list[Figure]:
    """Return errors on evaluation sequences of the fitted string and of predictors without physics."""
    fitted, cpu_s = fitted_on(training)
    known = {"sequences": len(sequences), "seconds": FRAME_S * sequences.shape[1]}
    about_fit = {
        "cpu_s": cpu_s,
        "unknowns": fitted.fit.values(),
        "fit_m": fitted.fit.log.best()[1],
        "roll": fitted.fit.roll,
    }
    figures = []
    for name, predict in {"string": fitted, **TRIVIAL}.items():
        own, detail = name == "string", known | (about_fit if name == "string" else {})
        coordinate, distance = errors_m(predict, sequences)
        figures += [
            Figure(
                f"deform_dlo.coordinate.{cable}.{name}",
                1e3 * coordinate,
                "mm",
                PUBLISHED_MM if own else None,
                "all vertices, driven ones counted as 0; " + ("fitted" if own else "without physics"),
                detail,
            ),
            Figure(f"deform_dlo.distance.{cable}.{name}", 1e3 * distance, "mm", note="free vertices"),
        ]
    return figures


def measure(folder: Path) -> list[Figure]:
    """Return the figures of all cables of a folder."""
    figures = []
    for cable in cables_in(folder):
        training, sequences = (np.load(folder / f"{cable}_{part}.npy") for part in ("train", "eval"))
        figures += held_out(cable, training)
        figures += [sticking(cable, training, sequences), *predicted(cable, training, sequences)]
    return figures
