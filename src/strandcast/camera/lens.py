"""A lens from photos of a ChArUco board: sub-pixel corners, the smallest sufficient distortion, residuals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from strandcast.camera.markers import CharucoBoard, eight_bit, opencv_board
from strandcast.errors import StrandcastError
from strandcast.records.camera import Lens, View

# Free distortion coefficients, smallest model first; (OpenCV's flags, number of free coefficients).
MODELS = {
    "radial1": (cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST, 1),
    "radial2": (cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST, 2),
    "tangential": (cv2.CALIB_FIX_K3, 4),
    "radial3": (cv2.CALIB_ZERO_TANGENT_DIST, 3),
    "full": (0, 5),
}
LEAST_VIEWS = 3
LEAST_CORNERS = 8
OUTLIER_RATIO = 3.0  # a view's rms over the others' median …
OUTLIER_FLOOR_PX = 0.5  # … and at least this much
UNSURE_FOCAL_SHARE = 0.02


@dataclass(frozen=True)
class _Corners:
    """The board's corners in one photo: places on the board (m, 3) [m] and in the picture (m, 2) [px]."""

    name: str
    board_m: np.ndarray
    picture_px: np.ndarray


@dataclass(frozen=True)
class _Fit:
    model: str
    rms_px: float
    matrix: np.ndarray
    distortion: np.ndarray
    standard_errors: np.ndarray
    residuals_px: list[np.ndarray]  # per view (m, 2): measured minus model


def calibrate_lens(
    images: Sequence[tuple[str, np.ndarray]],
    board: CharucoBoard,
    model: str = "auto",
    least_corners: int = LEAST_CORNERS,
) -> Lens:
    """Fit a lens to photos of a ChArUco board.

    Parameters
    ----------
    images
        (name, grey picture (height, width)), at least three usable ones, the board held at unlike tilts.
    board
        The board as printed.
    model
        ``radial1``, ``radial2``, ``tangential`` (k1, k2, p1, p2), ``radial3``, ``full``, or ``auto``: the one
        with the least Akaike information, among those that do not fold within the picture. Few photos get few
        terms.
    least_corners
        A photo with fewer corners is left out.

    Returns
    -------
    Lens
        With every photo's residuals [px], measured minus model, and the reason why one was left out.

    Raises
    ------
    StrandcastError
        Photos of different sizes, fewer than three usable photos, an unknown model, no usable fit.
    """
    if model != "auto" and model not in MODELS:
        raise StrandcastError(
            "SC-C010",
            f"there is no distortion model {model!r}",
            field="model",
            fix=f"use one of auto, {', '.join(MODELS)}",
        )
    size = _common_size(images)
    seen, views = _find_corners(images, board, least_corners)
    used, fit = _fit_without_outliers(seen, views, size, list(MODELS) if model == "auto" else [model])
    for corners, residuals in zip(used, fit.residuals_px, strict=True):
        views[corners.name].residuals_px = np.column_stack([corners.picture_px, residuals]).round(4).tolist()
        views[corners.name].rms_px = _rms(residuals)
        views[corners.name].used = True
    return Lens(
        width_px=size[0],
        height_px=size[1],
        matrix=fit.matrix.tolist(),
        distortion=fit.distortion.tolist(),
        rms_px=fit.rms_px,
        standard_errors=dict(
            zip(("fx_px", "fy_px", "cx_px", "cy_px"), fit.standard_errors[:4].tolist(), strict=True)
        ),
        views=list(views.values()),
        model=fit.model,
        warnings=_warnings(fit, used, size),
    )


def find_board(grey: np.ndarray, board: CharucoBoard) -> tuple[np.ndarray, np.ndarray]:
    """Return the board's corners seen in a picture: ids (m,) and pixels (m, 2), sub-pixel."""
    found, ids, _, _ = cv2.aruco.CharucoDetector(opencv_board(board)).detectBoard(eight_bit(grey))
    if ids is None or len(ids) == 0:
        return np.zeros(0, int), np.zeros((0, 2))
    return np.asarray(ids, int).reshape(-1), np.asarray(found, float).reshape(-1, 2)


def _common_size(images: Sequence[tuple[str, np.ndarray]]) -> tuple[int, int]:
    if not images:
        raise StrandcastError(
            "SC-C011",
            "there are no board photos",
            fix="take ten photos of the ChArUco board, tilted, over the whole picture",
        )
    first_name, first = images[0]
    for name, grey in images:
        if grey.shape != first.shape:
            raise StrandcastError(
                "SC-C012",
                f"is {_size_words(grey)}, {first_name} is {_size_words(first)}",
                file=name,
                fix="calibrate with photos from the one camera and mode that films the throw",
            )
    return first.shape[1], first.shape[0]


def _size_words(grey: np.ndarray) -> str:
    return f"{grey.shape[1]} x {grey.shape[0]} px"


def _find_corners(
    images: Sequence[tuple[str, np.ndarray]], board: CharucoBoard, least: int
) -> tuple[list[_Corners], dict[str, View]]:
    places = np.asarray(opencv_board(board).getChessboardCorners(), float)
    seen, views = [], {}
    for name, grey in images:
        ids, picture_px = find_board(grey, board)
        view = View(file=name, corners=len(ids), rms_px=None, used=False)
        views[name] = view
        if len(ids) < least:
            view.reason = f"only {len(ids)} of {len(places)} corners seen, at least {least} are needed"
        elif _on_one_line(places[ids]):
            view.reason = "the corners seen lie on one line"
        else:
            seen.append(_Corners(name, places[ids], picture_px))
    return seen, views


def _on_one_line(places_m: np.ndarray) -> bool:
    spread = np.linalg.svd(places_m - places_m.mean(axis=0), compute_uv=False)
    return bool(spread[1] < 1e-6 * max(spread[0], 1e-12))


def _fit_without_outliers(
    seen: list[_Corners], views: dict[str, View], size: tuple[int, int], models: list[str]
) -> tuple[list[_Corners], _Fit]:
    """Fit, leave out the worst photo if it stands out, fit again."""
    used = list(seen)
    while True:
        if len(used) < LEAST_VIEWS:
            raise _too_few(views)
        fit = _smallest_sufficient(used, size, models)
        rms = np.array([_rms(residuals) for residuals in fit.residuals_px])
        worst = int(np.argmax(rms))
        usual = float(np.median(np.delete(rms, worst)))
        if rms[worst] < max(OUTLIER_RATIO * usual, OUTLIER_FLOOR_PX) or len(used) == LEAST_VIEWS:
            return used, fit
        view = views[used.pop(worst).name]
        view.rms_px = float(rms[worst])
        view.reason = (
            f"fits with {rms[worst]:.2f} px rms where the others have {usual:.2f}: blurred, or a bent board?"
        )


def _smallest_sufficient(used: list[_Corners], size: tuple[int, int], models: list[str]) -> _Fit:
    """Return the fit with the least Akaike information; models that fold within the picture are out."""
    fits = [fit for fit in (_fit(used, size, model) for model in models) if not _folds(fit, size)]
    if not fits:
        raise StrandcastError(
            "SC-C014",
            "no distortion model fits the board photos without folding the picture",
            fix="take more photos, with the board near the corners of the picture too, and tilted",
        )
    numbers = 2 * sum(len(corners.picture_px) for corners in used)
    return min(fits, key=lambda fit: numbers * np.log(fit.rms_px**2) + 2 * MODELS[fit.model][1])


@contextmanager
def _one_thread() -> Iterator[None]:
    """Hold OpenCV to one thread: its threads add in an order of their own, and the last digits differ."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def _fit(used: list[_Corners], size: tuple[int, int], model: str) -> _Fit:
    board_m = [corners.board_m.astype(np.float32) for corners in used]
    picture_px = [corners.picture_px.astype(np.float32) for corners in used]
    with _one_thread():
        rms, matrix, distortion, turns, shifts, errors, *_ = cv2.calibrateCameraExtended(
            board_m, picture_px, size, None, None, flags=MODELS[model][0]
        )
    residuals = []
    for corners, turn, shift in zip(used, turns, shifts, strict=True):
        projected, _ = cv2.projectPoints(corners.board_m, turn, shift, matrix, distortion)
        residuals.append(corners.picture_px - np.asarray(projected, float).reshape(-1, 2))
    return _Fit(
        model,
        float(rms),
        np.asarray(matrix),
        np.asarray(distortion).reshape(-1)[:5],
        np.asarray(errors).reshape(-1),
        residuals,
    )


def _folds(fit: _Fit, size: tuple[int, int]) -> bool:
    """Tell whether the radial polynomial turns back before the picture's farthest corner."""
    far = max(
        np.hypot((u - fit.matrix[0, 2]) / fit.matrix[0, 0], (v - fit.matrix[1, 2]) / fit.matrix[1, 1])
        for u in (0, size[0])
        for v in (0, size[1])
    )
    k1, k2, _, _, k3 = fit.distortion
    square = np.linspace(0.0, 2.0 * far, 400) ** 2
    radius = np.sqrt(square) * (1 + k1 * square + k2 * square**2 + k3 * square**3)
    return not any(reached >= far for reached in radius[: _rising(radius)])


def _rising(values: np.ndarray) -> int:
    """Return how many values from the first on keep rising."""
    for index, (before, after) in enumerate(pairwise(values)):
        if after <= before:
            return index + 1
    return len(values)


def _rms(residuals_px: np.ndarray) -> float:
    return float(np.sqrt((residuals_px**2).sum(axis=1).mean()))


def _too_few(views: dict[str, View]) -> StrandcastError:
    usable = sum(view.reason is None for view in views.values())
    reasons = "; ".join(f"{view.file}: {view.reason}" for view in views.values() if view.reason)
    return StrandcastError(
        "SC-C013",
        f"{usable} usable board photos, at least {LEAST_VIEWS} are needed ({reasons or 'no others given'})",
        field="board",
        fix="check the board's dictionary, squares and sizes, then take more photos, sharp and tilted",
    )


def _warnings(fit: _Fit, used: list[_Corners], size: tuple[int, int]) -> list[str]:
    warnings = []
    share = float(np.max(fit.standard_errors[:2] / np.diag(fit.matrix)[:2]))
    if share > UNSURE_FOCAL_SHARE:
        warnings.append(
            f"the focal length is known to {share:.1%} only: add photos with the board tilted 30-45 degrees"
        )
    all_px = np.concatenate([corners.picture_px for corners in used])
    covered = float(np.prod(np.ptp(all_px, axis=0) / np.array(size)))
    if covered < 0.5:
        warnings.append(
            f"the corners cover {covered:.0%} of the picture: add photos with the board near its edges"
        )
    return warnings
