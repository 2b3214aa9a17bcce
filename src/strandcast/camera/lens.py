"""A lens from photos or a video of a ChArUco board: the smallest sufficient distortion, what is not known."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import islice

import cv2
import numpy as np

from strandcast.camera.distortion import LARGEST_PLAIN, MODELS, LensFit, choose_model, fit_lens, folds
from strandcast.camera.frames import choose_frames
from strandcast.camera.lens_error import lens_covariance
from strandcast.camera.markers import CharucoBoard
from strandcast.camera.views import (
    TRIED,
    BoardCorners,
    board_corners,
    common_size,
    find_board,
    refuse_unseen,
    settle_pattern,
)
from strandcast.errors import StrandcastError
from strandcast.records.camera import Coverage, Lens, ModelTrial, View

__all__ = ["calibrate_lens", "calibrate_lens_video", "find_board"]

LEAST_VIEWS = 3
LEAST_CORNERS = 8
OUTLIER_RATIO = 3.0  # a view's rms over the others' median …
OUTLIER_FLOOR_PX = 0.5  # … and at least this much
CELLS = (10, 6)  # of the coverage's grid over the picture
# Below these the photos are weak, and are told to be so.
FEW_VIEWS = 6
UNSURE_FOCAL_SHARE = 0.02
SMALL_BOARD_SHARE = 0.25
NARROW_TILTS_RAD = np.radians(15.0)
SHORT_REACH = 0.7
THIN_COVERAGE = 0.5

Found = list[tuple[View, BoardCorners | None]]


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
        The board as printed; its legacy pattern is found where it is not as given.
    model
        ``none``, ``k1``, ``k1k2``, ``k1k2p1p2``, ``k1k2k3p1p2``, ``rational``, or ``auto``: chosen by the
        residual over photos that were held out (`distortion.choose_model`).
    least_corners
        A photo with fewer corners is left out.

    Returns
    -------
    Lens
        With every photo's residuals [px], measured minus model, and the reason why one was left out; what the
        photos lack in `weaknesses`.

    Raises
    ------
    StrandcastError
        SC-C010 an unknown model; SC-C011 to SC-C014 no photos, of different sizes, fewer than three usable,
        no usable fit; SC-C016, SC-C017, SC-C023 another board, another dictionary, mirrored.
    """
    models = _models(model)
    size = common_size(images)
    board, warnings = settle_pattern(images, board)
    found = [board_corners(name, grey, board, least_corners) for name, grey in images]
    if _usable(found) == 0:
        refuse_unseen(images, board)
    return _lens(found, size, models, board, warnings)


def calibrate_lens_video(
    frames: Iterable[tuple[str, np.ndarray]],
    board: CharucoBoard,
    model: str = "auto",
    least_corners: int = LEAST_CORNERS,
) -> Lens:
    """Fit a lens to a video of a ChArUco board that is moved slowly about; as `calibrate_lens`.

    Parameters
    ----------
    frames
        (name, grey picture), streamed; a few a second will do. Those that are sharp and show the board in
        unlike places and poses are used.
    board, model, least_corners
        As for photos.
    """
    models = _models(model)
    frames = iter(frames)
    first = [(name, grey.copy()) for name, grey in islice(frames, TRIED)]
    size = common_size(first)
    board, warnings = settle_pattern(first, board)
    found = choose_frames(_all(first, frames), board, least_corners)
    if _usable(found) == 0:
        refuse_unseen(first, board)
    return _lens(found, size, models, board, warnings)


def _all(
    first: Iterable[tuple[str, np.ndarray]], others: Iterable[tuple[str, np.ndarray]]
) -> Iterable[tuple[str, np.ndarray]]:
    yield from first
    yield from others


def _models(model: str) -> list[str]:
    if model == "auto":
        return list(MODELS)
    if model not in MODELS:
        raise StrandcastError(
            "SC-C010",
            f"there is no distortion model {model!r}",
            field="camera.distortion",
            fix=f"use one of auto, {', '.join(MODELS)}",
        )
    return [model]


def _usable(found: Found) -> int:
    return sum(corners is not None for _, corners in found)


def _lens(
    found: Found, size: tuple[int, int], models: list[str], board: CharucoBoard, warnings: list[str]
) -> Lens:
    views = {view.file: view for view, _ in found}
    seen = [corners for _, corners in found if corners is not None]
    used, fit, trials = _fit_without_outliers(seen, views, size, models)
    for corners, turn, residuals in zip(used, fit.turns, fit.residuals_px, strict=True):
        view = views[corners.name]
        view.residuals_px = np.column_stack([corners.picture_px, residuals]).round(4).tolist()
        view.rms_px, view.used = _rms(residuals), True
        view.tilt_rad = float(np.arccos(min(1.0, abs(cv2.Rodrigues(turn)[0][2, 2]))))
    coverage = _coverage(used, fit, size)
    return Lens(
        width_px=size[0],
        height_px=size[1],
        matrix=fit.matrix.tolist(),
        distortion=fit.distortion.tolist(),
        rms_px=fit.rms_px,
        standard_errors=_standard_errors(fit),
        views=list(views.values()),
        model=fit.model,
        models=trials,
        held_out_px=next((trial.held_out_px for trial in trials if trial.model == fit.model), None),
        coverage=coverage,
        covariance=lens_covariance(used, fit, size).tolist(),
        legacy=board.legacy,
        warnings=warnings,
        weaknesses=_weaknesses(fit, used, coverage, size),
    )


def _fit_without_outliers(
    seen: list[BoardCorners], views: dict[str, View], size: tuple[int, int], models: list[str]
) -> tuple[list[BoardCorners], LensFit, list[ModelTrial]]:
    """Leave out photos that stand out, the worst first; then choose the model and fit."""
    used = list(seen)
    plain = LARGEST_PLAIN if LARGEST_PLAIN in models else models[0]
    while True:
        if len(used) < LEAST_VIEWS:
            raise _too_few(views)
        rms = np.array([_rms(residuals) for residuals in fit_lens(used, size, plain).residuals_px])
        worst = int(np.argmax(rms))
        usual = float(np.median(np.delete(rms, worst)))
        if rms[worst] < max(OUTLIER_RATIO * usual, OUTLIER_FLOOR_PX) or len(used) == LEAST_VIEWS:
            break
        view = views[used.pop(worst).name]
        view.rms_px = float(rms[worst])
        view.reason = (
            f"fits with {rms[worst]:.2f} px rms where the others have {usual:.2f}: blurred, or a bent board?"
        )
    chosen, trials = choose_model(used, size, models)
    return used, fit_lens(used, size, chosen), trials


def _rms(residuals_px: np.ndarray) -> float:
    return float(np.sqrt((residuals_px**2).sum(axis=1).mean()))


def _standard_errors(fit: LensFit) -> dict[str, float]:
    """Return the standard errors of the numbers that were free, the pinhole's in pixels."""
    names = [*("fx_px", "fy_px", "cx_px", "cy_px"), *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")]
    free = {name.removesuffix("_px") for name in fit.free()}
    return {
        name: float(error)
        for name, error in zip(names, fit.standard_errors, strict=False)
        if name.removesuffix("_px") in free
    }


def _too_few(views: dict[str, View]) -> StrandcastError:
    usable = sum(view.reason is None for view in views.values())
    reasons = "; ".join(f"{view.file}: {view.reason}" for view in list(views.values())[:20] if view.reason)
    return StrandcastError(
        "SC-C013",
        f"{usable} usable board photos, at least {LEAST_VIEWS} are needed ({reasons or 'no others given'})",
        field="camera.board",
        cost="without a lens, a usual one (k1 = -0.12) costs 4 mm in the mean and 6 mm at the edges",
        fix="check the board's dictionary, squares and sizes, then take more photos, sharp and tilted",
    )


def _coverage(used: list[BoardCorners], fit: LensFit, size: tuple[int, int]) -> Coverage:
    """Return where in the picture the corners were, and how unlike the boards' tilts."""
    all_px = np.concatenate([corners.picture_px for corners in used])
    counts, _, _ = np.histogram2d(
        all_px[:, 1], all_px[:, 0], bins=CELLS[::-1], range=((0, size[1]), (0, size[0]))
    )
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in fit.turns])
    middle = np.array(size) / 2.0
    return Coverage(
        cells=counts.astype(int).tolist(),
        share=float((counts > 0).mean()),
        reach=float(np.linalg.norm(all_px - middle, axis=1).max() / np.linalg.norm(middle)),
        board_share=float(np.median([np.ptp(each.picture_px[:, 0]) for each in used]) / size[0]),
        tilt_spread_rad=float(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max()),
    )


def _weaknesses(
    fit: LensFit, used: list[BoardCorners], coverage: Coverage, size: tuple[int, int]
) -> list[str]:
    """Say what the photos lack; the plane's part says what it costs there."""
    corners_px = np.array([[0, 0], [size[0], 0], [0, size[1]], size], float)
    focal_share = float(np.max(fit.standard_errors[:2] / np.diag(fit.matrix)[:2]))
    spread_deg = np.degrees(coverage.tilt_spread_rad)
    told = [
        (len(used) < FEW_VIEWS, f"only {len(used)} photos of the board: take ten"),
        (
            coverage.tilt_spread_rad < NARROW_TILTS_RAD,
            f"the boards are all parallel within {spread_deg:.0f} degrees: tilt them 30-45 degrees each way",
        ),
        (
            coverage.board_share < SMALL_BOARD_SHARE,
            f"the board takes {coverage.board_share:.0%} of the picture's width only: hold it nearer",
        ),
        (
            coverage.reach < SHORT_REACH,
            f"no corner lies beyond {coverage.reach:.0%} of the way from the picture's middle to its "
            "corners: add photos with the board near them",
        ),
        (
            coverage.share < THIN_COVERAGE,
            f"the corners cover {coverage.share:.0%} of the picture: hold the board near its edges too",
        ),
        (
            focal_share > UNSURE_FOCAL_SHARE,
            f"the focal length is known to {focal_share:.1%} only: add photos with the board tilted",
        ),
        (
            folds(fit, corners_px),
            "the lens fitted cannot be right in the picture's corners: add photos there",
        ),
    ]
    return [words for weak, words in told if weak]
