"""Lens calibration from photos or a video of a ChArUco board."""

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain, islice

import cv2
import numpy as np

from strandcast.camera.distortion import (
    FISHEYE,
    LARGEST_POLYNOMIAL,
    MODELS,
    PINHOLE,
    LensFit,
    choose_model,
    fit_lens,
    folds_picture,
    is_wide,
)
from strandcast.camera.frames import choose_frames
from strandcast.camera.lens_error import lens_covariance, repeat_inflation
from strandcast.camera.markers import patterned
from strandcast.camera.pose import rms
from strandcast.camera.printed_board import TRIED, PrintedBoard, identify_board
from strandcast.camera.views import BoardCorners, board_corners, check_sizes, pose_groups
from strandcast.config.camera import Board
from strandcast.errors import StrandcastError
from strandcast.records.camera import BoardView, Coverage, Lens, ModelTrial

MIN_VIEWS = 3  # chosen; also of distinct poses
LISTED = 4  # chosen: reasons in a message
GROUPS = 10  # chosen: of `TRIED` frames of a video, which may begin before its board is in view
# Largest angle between two boards, below which the focal length is refused. Measured on six simulated views
# of a board bowed by 0.3 mm: the focal length is off by 7.5 % rms at 3 degrees, 4.6 % at 8, 1.5 % at 20, and
# 1.6 %, 1.1 %, 0.6 % are stated.
LEAST_TILT_SPREAD_RAD = np.radians(3.0)
OUTLIER_RATIO = 3.0  # chosen: a view's rms over the others' median …
OUTLIER_FLOOR_PX = 0.5  # … and its smallest rms
CELLS = (10, 6)  # chosen: grid of the coverage over the picture
# Chosen: limits beyond which a weakness of the photos is reported.
ENOUGH_VIEWS = 6
MAX_FOCAL_ERROR = 0.02
MIN_BOARD_SHARE = 0.25
MIN_TILT_SPREAD_RAD = np.radians(15.0)
MIN_REACH = 0.7
MIN_COVERAGE = 0.5
LARGE_RMS_PX = 1.0

BoardViews = list[tuple[BoardView, BoardCorners | None]]


def calibrate_lens(
    images: Sequence[tuple[str, np.ndarray]], board: Board, model: str = "auto"
) -> tuple[Lens, PrintedBoard]:
    """Fit a lens to photos of a ChArUco board; also return the board as printed.

    The images are (name, grey picture (height, width)), at least three usable ones with different tilts of
    the board. Pattern and first id of the board are as they show them (`identify_board`). The model is
    ``none``, ``k1``, ``k1k2``, ``k1k2p1p2``, ``k1k2k3p1p2``, ``rational``, ``fisheye``, or ``auto``:
    ``fisheye`` where it fits better than any polynomial (`distortion.is_wide`), else one of the others,
    chosen by cross-validation (`distortion.choose_model`).

    The lens has every photo's residuals [px], measured minus model, the reasons why photos were not used, and
    the shortcomings of the photos in `weaknesses`.

    Raises
    ------
    StrandcastError
        SC-W021 an unknown model; SC-C030 no photos; SC-C012 photos of different sizes; SC-C013 fewer than
        three usable, no usable fit, too few distinct poses or tilts of the board; SC-C016, SC-C023 as
        `identify_board`.
    """
    models = _models(model)
    check_sizes(images)
    printed = identify_board(images, board)
    found = [board_corners(name, printed.black_on_white(grey), printed.board) for name, grey in images]
    return _lens(found, images[0][1].shape, models, printed), printed


def calibrate_lens_video(
    frames: Iterable[tuple[str, np.ndarray]], board: Board, model: str = "auto"
) -> tuple[Lens, PrintedBoard]:
    """Fit a lens to a video of a slowly moving ChArUco board; as `calibrate_lens`.

    `frames` (name, grey picture) are streamed; a few per second are enough. Sharp ones with different poses
    of the board are used.
    """
    models = _models(model)
    frames = iter(frames)
    first: list[tuple[str, np.ndarray]] = []
    for _ in range(GROUPS):
        group = [(name, grey.copy()) for name, grey in islice(frames, TRIED)]
        first += group
        printed = identify_board(group, board)
        if printed.is_shown or printed.warnings or printed.board != patterned(board):
            break
    check_sizes(first)
    pictures = ((name, printed.black_on_white(grey)) for name, grey in chain(first, frames))
    found = choose_frames(pictures, printed.board)
    return _lens(found, first[0][1].shape, models, printed), printed


def _models(model: str) -> list[str]:
    if model == "auto":
        return [*MODELS, FISHEYE]
    if model not in (*MODELS, FISHEYE):
        fix = f"use one of auto, {', '.join((*MODELS, FISHEYE))}"
        what = f"there is no distortion model {model!r}"
        raise StrandcastError("SC-W021", what, field="camera.distortion", fix=fix)
    return [model]


def _lens(found: BoardViews, shape: tuple[int, ...], models: list[str], printed: PrintedBoard) -> Lens:
    size = (shape[1], shape[0])
    views = {view.file: view for view, _ in found}
    usable = [corners for _, corners in found if corners is not None]
    used, groups, fit, trials = _fit_without_outliers(usable, views, size, models, printed.of_size)
    for corners, rotation, residuals in zip(used, fit.rotations, fit.residuals_px, strict=True):
        view = views[corners.name]
        view.residuals_px = np.column_stack([corners.picture_px, residuals]).round(4).tolist()
        view.rms_px, view.used = rms(residuals), True
        view.tilt_rad = float(np.arccos(min(1.0, abs(cv2.Rodrigues(rotation)[0][2, 2]))))
    coverage = _coverage(used, fit, size)
    _refuse_equal_tilts(coverage)
    return Lens(
        width_px=size[0],
        height_px=size[1],
        matrix=fit.matrix.tolist(),
        distortion=fit.distortion.tolist(),
        rms_px=fit.rms_px,
        standard_errors=_standard_errors(fit, repeat_inflation(used, fit, groups)),
        views=list(views.values()),
        model=fit.model,
        models=trials,
        held_out_px=next((trial.held_out_px for trial in trials if trial.model == fit.model), None),
        coverage=coverage,
        covariance=lens_covariance(used, fit, size, groups).tolist(),
        legacy=printed.board.legacy,
        warnings=printed.warnings,
        weaknesses=_weaknesses(fit, groups, coverage, size),
    )


def _fit_without_outliers(
    usable: list[BoardCorners],
    views: dict[str, BoardView],
    size: tuple[int, int],
    models: list[str],
    of_size: Sequence[str],
) -> tuple[list[BoardCorners], np.ndarray, LensFit, list[ModelTrial]]:
    """Reject outlying photos, the worst first; then choose the model and fit. Also return the poses."""
    used = list(usable)
    if FISHEYE in models and len(models) > 1 and len(used) >= MIN_VIEWS:
        models = [FISHEYE] if is_wide(used, size) else list(MODELS)
    trial_model = LARGEST_POLYNOMIAL if LARGEST_POLYNOMIAL in models else models[0]
    while True:
        if len(used) < MIN_VIEWS:
            raise _too_few(views, of_size)
        groups = _refuse_repeated_poses(used)
        rms_px = [rms(residuals) for residuals in fit_lens(used, size, trial_model).residuals_px]
        worst = int(np.argmax(rms_px))
        usual = float(np.median(np.delete(rms_px, worst)))
        if rms_px[worst] < max(OUTLIER_RATIO * usual, OUTLIER_FLOOR_PX) or len(used) == MIN_VIEWS:
            break
        view = views[used.pop(worst).name]
        view.rms_px = rms_px[worst]
        residual = f"its residual is {rms_px[worst]:.2f} px rms, the others' {usual:.2f}"
        view.reason = f"{residual}: blurred photo or bent board?"
    chosen, trials = choose_model(used, size, models, groups)
    return used, groups, fit_lens(used, size, chosen), trials


def _standard_errors(fit: LensFit, inflation: np.ndarray) -> dict[str, float]:
    """Return the standard errors of the free parameters; those of the pinhole in pixels."""
    return {
        f"{name}_px" if name in PINHOLE else name: float(error)
        for name, error in zip(fit.names(), fit.standard_errors * inflation, strict=True)
        if name in fit.free()
    }


def _too_few(views: dict[str, BoardView], of_size: Sequence[str]) -> StrandcastError:
    usable = sum(view.reason is None for view in views.values())
    reasons = Counter(view.reason for view in views.values() if view.reason)
    left_out = "; ".join(f"in {count} of {len(views)}, {why}" for why, count in reasons.most_common(LISTED))
    return StrandcastError(
        "SC-C013",
        f"{usable} usable board photos; at least {MIN_VIEWS} are needed ({left_out or 'no others given'})",
        field="camera.board",
        cost="ignoring a typical lens (k1 = -0.12) costs 4 mm on average and 6 mm at the edges",
        fix="; ".join(of_size)
        or "check the board's dictionary, squares and sizes, then take more photos, sharp and tilted",
    )


def _refuse_repeated_poses(used: list[BoardCorners]) -> np.ndarray:
    """Return the photos' poses by number, or refuse them if there are too few distinct ones."""
    groups = pose_groups(used)
    poses = int(groups.max()) + 1
    if poses < MIN_VIEWS:
        what = f"the {len(used)} usable board photos show {poses} distinct pose{'s' if poses > 1 else ''}"
        raise _undetermined(f"{what}; at least {MIN_VIEWS} are needed", "more than half")
    return groups


def _refuse_equal_tilts(coverage: Coverage) -> None:
    if coverage.tilt_spread_rad < LEAST_TILT_SPREAD_RAD:
        least, found = np.degrees([LEAST_TILT_SPREAD_RAD, coverage.tilt_spread_rad])
        what = f"the tilts of the board photos differ by {found:.1f} degrees; at least {least:.0f} are needed"
        raise _undetermined(what, "10 %")


def _undetermined(what: str, focal_error: str) -> StrandcastError:
    return StrandcastError(
        "SC-C013",
        what,
        field="camera.lens",
        cost=f"the focal length may be wrong by {focal_error}, with a small standard error",
    )


def _coverage(used: list[BoardCorners], fit: LensFit, size: tuple[int, int]) -> Coverage:
    """Return how the corners cover the picture, and how much the boards' tilts differ."""
    all_px = np.concatenate([corners.picture_px for corners in used])
    counts, _, _ = np.histogram2d(
        all_px[:, 1], all_px[:, 0], bins=CELLS[::-1], range=((0, size[1]), (0, size[0]))
    )
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in fit.rotations])
    centre = np.array(size) / 2.0
    return Coverage(
        cells=counts.astype(int).tolist(),
        share=float((counts > 0).mean()),
        reach=float(np.linalg.norm(all_px - centre, axis=1).max() / np.linalg.norm(centre)),
        board_share=float(np.median([np.ptp(each.picture_px[:, 0]) for each in used]) / size[0]),
        tilt_spread_rad=float(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max()),
    )


def _weaknesses(fit: LensFit, groups: np.ndarray, coverage: Coverage, size: tuple[int, int]) -> list[str]:
    """Return the shortcomings of the photos; the plane's calibration reports what they cost there."""
    corners_px = np.array([[0, 0], [size[0], 0], [0, size[1]], size], float)
    focal_share = float(np.max(fit.standard_errors[:2] / np.diag(fit.matrix)[:2]))
    spread_deg = np.degrees(coverage.tilt_spread_rad)
    poses = int(groups.max()) + 1
    few = f"{poses} photos" if poses == len(groups) else f"{poses} distinct poses in {len(groups)} photos"
    checks = [
        (poses < ENOUGH_VIEWS, f"only {few} of the board: take ten"),
        (
            coverage.tilt_spread_rad < MIN_TILT_SPREAD_RAD,
            f"the boards' tilts differ by {spread_deg:.0f} degrees only, so that a board bowed by 0.3 mm "
            "changes the focal length by 3-8 %: tilt them 30-45 degrees each way, or give the known lens in "
            "camera.lens",
        ),
        (
            coverage.board_share < MIN_BOARD_SHARE,
            f"the board covers only {coverage.board_share:.0%} of the picture's width: move it closer",
        ),
        (
            coverage.reach < MIN_REACH,
            f"no corner is farther than {coverage.reach:.0%} of the way from the picture's centre to its "
            "corners: add photos with the board near them",
        ),
        (
            coverage.share < MIN_COVERAGE,
            f"the corners cover {coverage.share:.0%} of the picture: hold the board near its edges too",
        ),
        (
            focal_share > MAX_FOCAL_ERROR,
            f"the focal length is uncertain by {focal_share:.1%}: add photos with the board tilted",
        ),
        (
            fit.rms_px > LARGE_RMS_PX,
            f"its corners are off by {fit.rms_px:.1f} px rms, where sharp photos of a flat board give 0.1 to "
            "0.5: a bent board, or a lens that no model fits",
        ),
        (
            folds_picture(fit, corners_px),
            "the fitted lens is not valid in the picture's corners: add photos there",
        ),
    ]
    return [text for weak, text in checks if weak]
