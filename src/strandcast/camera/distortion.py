"""Selection of the distortion model: models fitted to some photos are tested on the others."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np

from strandcast.camera import fisheye
from strandcast.camera.projection import project_points
from strandcast.camera.views import BoardCorners
from strandcast.errors import StrandcastError
from strandcast.records.camera import ModelTrial, coefficient_names

PINHOLE = ("fx", "fy", "cx", "cy")
_FIXED = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
# Free coefficients, smallest model first, and OpenCV's flags.
MODELS: dict[str, tuple[tuple[str, ...], int]] = {
    "none": ((), _FIXED),
    "k1": (("k1",), _FIXED & ~cv2.CALIB_FIX_K1),
    "k1k2": (("k1", "k2"), cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST),
    "k1k2p1p2": (("k1", "k2", "p1", "p2"), cv2.CALIB_FIX_K3),
    "k1k2k3p1p2": (("k1", "k2", "p1", "p2", "k3"), 0),
    # OpenCV's six radial terms are nearly degenerate: poles arise between the corners. Four are enough.
    "rational": (
        ("k1", "k2", "p1", "p2", "k4", "k5"),
        cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_FIX_K3 | cv2.CALIB_FIX_K6,
    ),
}
FISHEYE = "fisheye"
LARGEST_POLYNOMIAL = "k1k2k3p1p2"
MAX_FOLDS = 6  # chosen: of the cross-validation
FOLD_MARGIN = 1.1  # chosen: distance from the picture's centre, relative to the corners', without folding
TERMINATION = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
EQUIVALENT_RMS = 1.01  # chosen: relative to the best rms; less is not worth a coefficient
NARROW = 0.7  # chosen: focal lengths above, in widths of the picture, are no fisheye lens; 71 degrees
FISHEYE_MAX_RMS = 0.8  # chosen: median rms of a photo under a fisheye lens relative to the best polynomial
RATIONAL_MAX_RMS = 0.95  # chosen: held-out rms of the rational model relative to the best polynomial


@dataclass(frozen=True)
class LensFit:
    """A fitted model: matrix (3, 3), distortion (4, 5 or 8,), pose and residuals of each photo."""

    model: str
    rms_px: float
    matrix: np.ndarray
    distortion: np.ndarray
    standard_errors: np.ndarray  # of PINHOLE and COEFFICIENTS; 0 where fixed
    rotations: list[np.ndarray]  # Rodrigues vectors (3,), board to camera
    translations_m: list[np.ndarray]  # (3,)
    residuals_px: list[np.ndarray]  # per view (m, 2): measured minus model

    def free(self) -> tuple[str, ...]:
        """Return the names of the free parameters."""
        return PINHOLE + (
            coefficient_names(self.distortion.tolist()) if self.model == FISHEYE else MODELS[self.model][0]
        )

    def names(self) -> tuple[str, ...]:
        """Return the names of all parameters."""
        return PINHOLE + coefficient_names(self.distortion.tolist())


@contextmanager
def single_thread() -> Iterator[None]:
    """Restrict OpenCV to one thread: the order in which threads add up changes the last digits."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def fit_lens(
    views: Sequence[BoardCorners], size: tuple[int, int], model: str, start: LensFit | None = None
) -> LensFit:
    """Fit a pinhole and one distortion model to the corners of all photos (Zhang 2000, by OpenCV).

    `start` is a fit of the same model to most of the photos; it replaces the initial guess.
    """
    if model == FISHEYE:
        return _fit_fisheye(views, size, start)
    flags, matrix, distortion = MODELS[model][1], None, None
    if start is not None:
        flags |= cv2.CALIB_USE_INTRINSIC_GUESS
        matrix, distortion = start.matrix.copy(), start.distortion.copy()
    board_m = [corners.board_m.astype(np.float32) for corners in views]
    picture_px = [corners.picture_px.astype(np.float32) for corners in views]
    with single_thread():
        rms, matrix, distortion, rotations, translations, errors, *_ = cv2.calibrateCameraExtended(
            board_m, picture_px, size, matrix, distortion, flags=flags, criteria=TERMINATION
        )
    count = 8 if model == "rational" else 5
    distortion = np.asarray(distortion).reshape(-1)[:count]
    residuals = [
        corners.picture_px - project_points(corners.board_m, rotation, translation, matrix, distortion)[0]
        for corners, rotation, translation in zip(views, rotations, translations, strict=True)
    ]
    return LensFit(
        model,
        float(rms),
        np.asarray(matrix),
        distortion,
        np.asarray(errors).reshape(-1)[: 4 + count],
        [np.asarray(rotation).reshape(3) for rotation in rotations],
        [np.asarray(translation).reshape(3) for translation in translations],
        residuals,
    )


def _fit_fisheye(views: Sequence[BoardCorners], size: tuple[int, int], start: LensFit | None) -> LensFit:
    corners = [(each.board_m, each.picture_px) for each in views]
    begin = None if start is None else (start.matrix, start.distortion)
    matrix, distortion, poses, errors = fisheye.calibrate(corners, *size, begin)
    residuals = [
        each.picture_px - project_points(each.board_m, pose[:3], pose[3:], matrix, distortion)[0]
        for each, pose in zip(views, poses, strict=True)
    ]
    square = float((np.concatenate(residuals) ** 2).sum(axis=1).mean())
    turns, shifts = list(poses[:, :3]), list(poses[:, 3:])
    return LensFit(FISHEYE, square**0.5, matrix, distortion, errors, turns, shifts, residuals)


def is_wide(views: Sequence[BoardCorners], size: tuple[int, int]) -> bool:
    """Return whether a fisheye lens fits most photos better than any polynomial does."""
    polynomial = fit_lens(views, size, LARGEST_POLYNOMIAL)
    if polynomial.matrix[0, 0] > NARROW * size[0]:
        return False
    fits = polynomial, fit_lens(views, size, FISHEYE)
    bent, wide = (np.median([(off**2).sum(axis=1).mean() for off in fit.residuals_px]) for fit in fits)
    return bool(wide < FISHEYE_MAX_RMS**2 * bent)


def choose_model(
    views: Sequence[BoardCorners],
    size: tuple[int, int],
    models: Sequence[str],
    groups: np.ndarray | None = None,
) -> tuple[str, list[ModelTrial]]:
    """Return the smallest model that predicts held-out photos as well as the best one, and all trials.

    Each photo is predicted by a lens fitted without it and without those of the same pose, by `groups`
    (`views.pose_groups`); only its pose is fitted to it. Models are compared
    photo by photo, by the logarithm of their mean squares, so a steep view with large residuals counts no
    more than a good one. A model is as good as the best if its mean is within one standard error. The
    rational model extrapolates badly, so it must be better by two standard errors and by 5 %. Models that
    fold the picture where corners were, or slightly beyond, are rejected.

    Raises
    ------
    StrandcastError
        SC-C013 all models are rejected.
    """
    centre = np.array(size) / 2.0
    reached_px = centre + FOLD_MARGIN * (np.concatenate([each.picture_px for each in views]) - centre)
    groups = np.arange(len(views)) if groups is None else groups
    trials, squares = [], {}
    for model in models:
        whole = fit_lens(views, size, model)
        if folds_picture(whole, reached_px):
            trials.append(ModelTrial(model=model, held_out_px=None, reason="folds the picture"))
            continue
        squares[model] = _held_out(views, size, whole, groups)
        trials.append(ModelTrial(model=model, held_out_px=float(np.sqrt(squares[model].mean()))))
    if not squares:
        what = "no distortion model fits the board photos without folding the picture"
        fix = (
            "set camera.distortion: fisheye if the lens sees more than some 110 degrees; else take more "
            "photos, with the board tilted and also near the picture's corners"
        )
        raise StrandcastError("SC-C013", what, fix=fix)
    return smallest_as_good(squares), trials


def smallest_as_good(squares: dict[str, np.ndarray]) -> str:
    """Return the model to use, given its mean square [px²] in each photo (n,); smallest models first."""
    logs = {model: np.log(np.maximum(each, 1e-12)) for model, each in squares.items()}
    polynomials = [model for model in logs if model != "rational"]
    if not polynomials:
        return "rational"
    best = min(polynomials, key=lambda model: logs[model].mean())
    if "rational" in logs:
        better = (logs["rational"] - logs[best]).mean() < 2.0 * np.log(RATIONAL_MAX_RMS)
        if better and _excess(logs[best], logs["rational"]) > 2.0:
            return "rational"
    return next(model for model in polynomials if _as_good(logs[model], logs[best]))


def _as_good(logs: np.ndarray, best: np.ndarray) -> bool:
    return _excess(logs, best) <= 1.0 or (logs - best).mean() < 2.0 * np.log(EQUIVALENT_RMS)


def _excess(logs: np.ndarray, best: np.ndarray) -> float:
    """Return the mean difference of paired values in standard errors."""
    difference = logs - best
    error = difference.std(ddof=1) / np.sqrt(len(difference))
    return float(difference.mean() / error) if error > 0 else 0.0


def _held_out(
    views: Sequence[BoardCorners], size: tuple[int, int], whole: LensFit, groups: np.ndarray
) -> np.ndarray:
    """Return the mean square residual [px²] of each photo (n,) for lenses fitted without its pose."""
    folds = min(int(groups.max()) + 1, MAX_FOLDS)
    squares = np.empty(len(views))
    for fold in range(folds):
        out = groups % folds == fold
        fit = fit_lens(
            [each for each, hidden in zip(views, out, strict=True) if not hidden], size, whole.model, whole
        )
        squares[out] = [_mean_square(each, fit) for each, hidden in zip(views, out, strict=True) if hidden]
    return squares


def _mean_square(corners: BoardCorners, fit: LensFit) -> float:
    seen = corners.board_m, corners.picture_px, fit.matrix, fit.distortion
    if fit.model == FISHEYE:
        pose = fisheye.solve_pose(*seen)
    else:
        _, rotation, translation = cv2.solvePnP(*seen)
        pose = cv2.solvePnPRefineLM(*seen, rotation, translation)
    residuals = corners.picture_px - project_points(corners.board_m, *pose, fit.matrix, fit.distortion)[0]
    return float((residuals**2).sum(axis=1).mean())


def folds_picture(fit: LensFit, places_px: np.ndarray) -> bool:
    """Return whether the radial distortion stops rising before the farthest of some places (m, 2) [px]."""
    about = (places_px - fit.matrix[:2, 2]) / np.diag(fit.matrix)[:2]
    far = float(np.linalg.norm(about, axis=1).max())
    if fit.model == FISHEYE:
        return fisheye.folds(fit.distortion, far)
    k1, k2, _, _, k3, k4, k5, k6 = np.append(fit.distortion, np.zeros(8 - len(fit.distortion)))
    square = np.linspace(0.0, 5.0 * far, 1000) ** 2  # factor 5: wide lenses compress outer rays
    numerator = 1 + k1 * square + k2 * square**2 + k3 * square**3
    denominator = 1 + k4 * square + k5 * square**2 + k6 * square**3
    radius = np.where(denominator > 0, np.sqrt(square) * numerator / np.maximum(denominator, 1e-12), -np.inf)
    rising = np.append(True, np.logical_and.accumulate(radius[1:] > radius[:-1]))
    return not bool((radius[rising] >= far).any())
