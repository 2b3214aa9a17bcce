"""How much distortion the photos can tell: models fitted to some photos and tried on the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from strandcast.camera.views import BoardCorners
from strandcast.errors import StrandcastError
from strandcast.records.camera import ModelTrial

PINHOLE = ("fx", "fy", "cx", "cy")
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_FIXED = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
# The coefficients that are free, smallest model first, and OpenCV's flags.
MODELS: dict[str, tuple[tuple[str, ...], int]] = {
    "none": ((), _FIXED),
    "k1": (("k1",), _FIXED & ~cv2.CALIB_FIX_K1),
    "k1k2": (("k1", "k2"), cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST),
    "k1k2p1p2": (("k1", "k2", "p1", "p2"), cv2.CALIB_FIX_K3),
    "k1k2k3p1p2": (("k1", "k2", "p1", "p2", "k3"), 0),
    # All six of OpenCV's radial terms are so alike that poles arise between the corners; four do.
    "rational": (
        ("k1", "k2", "p1", "p2", "k4", "k5"),
        cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_FIX_K3 | cv2.CALIB_FIX_K6,
    ),
}
LARGEST_PLAIN = "k1k2k3p1p2"
MOST_FOLDS = 6
BEYOND = 1.1  # times as far from the picture's middle as corners were seen, a model must not fold
CONVERGED = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
AS_GOOD = 1.01  # of the best rms: no difference worth a coefficient
RATIONAL_PAYS = 0.95  # of the best other's held-out rms


@dataclass(frozen=True)
class LensFit:
    """One model fitted: matrix (3, 3), distortion (5 or 8,), poses and residuals of each photo."""

    model: str
    rms_px: float
    matrix: np.ndarray
    distortion: np.ndarray
    standard_errors: np.ndarray  # of PINHOLE and COEFFICIENTS; 0 where fixed
    turns: list[np.ndarray]
    shifts: list[np.ndarray]
    residuals_px: list[np.ndarray]  # per view (m, 2): measured minus model

    def free(self) -> tuple[str, ...]:
        """Return the names of the free numbers."""
        return PINHOLE + MODELS[self.model][0]


@contextmanager
def one_thread() -> Iterator[None]:
    """Hold OpenCV to one thread: its threads add in an order of their own, and the last digits differ."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def fit_lens(
    seen: Sequence[BoardCorners], size: tuple[int, int], model: str, start: LensFit | None = None
) -> LensFit:
    """Fit a pinhole and one distortion model to the corners of all photos (Zhang 2000, as OpenCV has it).

    `start`, a fit of the same model to most of them, spares the search for where to begin.
    """
    flags, matrix, distortion = MODELS[model][1], None, None
    if start is not None:
        flags |= cv2.CALIB_USE_INTRINSIC_GUESS
        matrix, distortion = start.matrix.copy(), start.distortion.copy()
    board_m = [corners.board_m.astype(np.float32) for corners in seen]
    picture_px = [corners.picture_px.astype(np.float32) for corners in seen]
    with one_thread():
        rms, matrix, distortion, turns, shifts, errors, *_ = cv2.calibrateCameraExtended(
            board_m, picture_px, size, matrix, distortion, flags=flags, criteria=CONVERGED
        )
    count = 8 if model == "rational" else 5
    distortion = np.asarray(distortion).reshape(-1)[:count]
    residuals = [
        corners.picture_px - _projected(corners, turn, shift, matrix, distortion)
        for corners, turn, shift in zip(seen, turns, shifts, strict=True)
    ]
    return LensFit(
        model,
        float(rms),
        np.asarray(matrix),
        distortion,
        np.asarray(errors).reshape(-1)[: 4 + count],
        [np.asarray(turn).reshape(3) for turn in turns],
        [np.asarray(shift).reshape(3) for shift in shifts],
        residuals,
    )


def _projected(
    corners: BoardCorners, turn: np.ndarray, shift: np.ndarray, matrix: np.ndarray, distortion: np.ndarray
) -> np.ndarray:
    projected, _ = cv2.projectPoints(corners.board_m, turn, shift, matrix, distortion)
    return np.asarray(projected, float).reshape(-1, 2)


def choose_model(
    seen: Sequence[BoardCorners], size: tuple[int, int], models: Sequence[str]
) -> tuple[str, list[ModelTrial]]:
    """Return the smallest model whose held-out residual is as good as the best's, and what each one did.

    Each photo is predicted by a lens that has not seen it (its pose alone is fitted to it). Models are held
    against each other photo by photo, by the logarithm of their mean squares: a steep view with large
    residuals counts no more than a good one. As good as the best: its mean is within one standard error. The
    rational model, which bends wildly where no corner was, must in turn be better by two standard errors and
    by 5 %. Models that fold the picture where corners were, or a little beyond, are out.

    Raises
    ------
    StrandcastError
        SC-C014: none is left.
    """
    middle = np.array(size) / 2.0
    reached_px = middle + BEYOND * (np.concatenate([each.picture_px for each in seen]) - middle)
    trials, squares = [], {}
    for model in models:
        whole = fit_lens(seen, size, model)
        if folds(whole, reached_px):
            trials.append(ModelTrial(model=model, held_out_px=None, reason="folds the picture"))
            continue
        squares[model] = _held_out(seen, size, whole)
        trials.append(ModelTrial(model=model, held_out_px=float(np.sqrt(squares[model].mean()))))
    if not squares:
        raise StrandcastError(
            "SC-C014",
            "no distortion model fits the board photos without folding the picture",
            fix="take more photos, with the board near the corners of the picture too, and tilted",
        )
    return smallest_as_good(squares), trials


def smallest_as_good(squares: dict[str, np.ndarray]) -> str:
    """Return the model to take, by its mean square [px²] in each photo (n,); smallest models first."""
    logs = {model: np.log(np.maximum(each, 1e-12)) for model, each in squares.items()}
    plain = [model for model in logs if model != "rational"]
    if not plain:
        return "rational"
    best = min(plain, key=lambda model: logs[model].mean())
    if "rational" in logs:
        pays = (logs["rational"] - logs[best]).mean() < 2.0 * np.log(RATIONAL_PAYS)
        if pays and _worse_by(logs[best], logs["rational"]) > 2.0:
            return "rational"
    return next(model for model in plain if _as_good(logs[model], logs[best]))


def _as_good(logs: np.ndarray, best: np.ndarray) -> bool:
    return _worse_by(logs, best) <= 1.0 or (logs - best).mean() < 2.0 * np.log(AS_GOOD)


def _worse_by(logs: np.ndarray, best: np.ndarray) -> float:
    """Return by how many standard errors the mean of one is above the other's, photo by photo."""
    difference = logs - best
    error = difference.std(ddof=1) / np.sqrt(len(difference))
    return float(difference.mean() / error) if error > 0 else 0.0


def _held_out(seen: Sequence[BoardCorners], size: tuple[int, int], whole: LensFit) -> np.ndarray:
    """Return the mean square residual [px²] of each photo (n,) under lenses fitted without it."""
    folds_count = min(len(seen), MOST_FOLDS)
    squares = np.empty(len(seen))
    for fold in range(folds_count):
        out = np.arange(len(seen)) % folds_count == fold
        fit = fit_lens(
            [each for each, hidden in zip(seen, out, strict=True) if not hidden], size, whole.model, whole
        )
        squares[out] = [_square_under(each, fit) for each, hidden in zip(seen, out, strict=True) if hidden]
    return squares


def _square_under(corners: BoardCorners, fit: LensFit) -> float:
    _, turn, shift = cv2.solvePnP(corners.board_m, corners.picture_px, fit.matrix, fit.distortion)
    turn, shift = cv2.solvePnPRefineLM(
        corners.board_m, corners.picture_px, fit.matrix, fit.distortion, turn, shift
    )
    off = corners.picture_px - _projected(corners, turn, shift, fit.matrix, fit.distortion)
    return float((off**2).sum(axis=1).mean())


def folds(fit: LensFit, places_px: np.ndarray) -> bool:
    """Tell whether the radial polynomial turns back before the farthest of some places (m, 2) [px]."""
    about = (places_px - fit.matrix[:2, 2]) / np.diag(fit.matrix)[:2]
    far = float(np.linalg.norm(about, axis=1).max())
    k1, k2, _, _, k3, k4, k5, k6 = np.append(fit.distortion, np.zeros(8 - len(fit.distortion)))
    square = np.linspace(0.0, 5.0 * far, 1000) ** 2  # a wide lens bends far rays in
    above = 1 + k1 * square + k2 * square**2 + k3 * square**3
    below = 1 + k4 * square + k5 * square**2 + k6 * square**3
    radius = np.where(below > 0, np.sqrt(square) * above / np.maximum(below, 1e-12), -np.inf)
    return not any(reached >= far for reached in radius[: _rising(radius)])


def _rising(values: np.ndarray) -> int:
    """Return how many values from the first on keep rising."""
    for index, (before, after) in enumerate(pairwise(values)):
        if after <= before:
            return index + 1
    return len(values)
