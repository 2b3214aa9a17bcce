"""The throw's frames compared with the calibration, the arm's file and the declared string."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from strandcast.camera.markers import eight_bit
from strandcast.camera.movement import check_movement, find_movement, shift_warnings
from strandcast.camera.tilt import PlaneTilt, fit_plane_tilt
from strandcast.records.camera import Camera
from strandcast.records.record import RigFault
from strandcast.tracking.background import Samples, pixel_median
from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.clamp_fit import LEAST_FRAMES, ClampFit
from strandcast.tracking.chain.detection import HIDES
from strandcast.tracking.chain.frames import StringFrames
from strandcast.tracking.chain.out_of_plane import OutOfPlane, apparent_strings, measure_out_of_plane
from strandcast.tracking.chain.string_track import StringTrack
from strandcast.tracking.hand.finder import HandDetection, HandFinder

LEAST_CONFIDENT = 0.3  # chosen: share of unflagged frames below which the user is warned
MOVED_FRAMES = 4  # chosen: frames compared with the photo of the plane
HARMLESS_BLUR_PX = 3.0  # chosen: blur over a whole frame interval that needs no known exposure
FASTEST_PERCENTILE = 99.0  # chosen: of the points' speeds; single wrong points are faster
# Chosen: range of the apparent length from which the string has left the plane, and that over its length;
# thrown in the plane, it was 1.0 mm at most.
TILTED_M, TILTED_SHARE = 0.003, 0.006
# Standard error of `detection.END_WIDTHS`, as a share of it: of its three kinds, frayed ends half as often.
END_SIGMA = 1.1
RULER_M = 0.0007  # of the declared length beyond a weight: two readings, each to half a millimetre
GRASP_M = 0.002  # chosen: by how much the length differs from throw to throw, as a hand clamps a string
SIGMAS = 4.0


def plane_tilts(camera: Camera, finder: HandFinder, hands: Sequence[HandDetection | None]) -> list[PlaneTilt]:
    """Return the plane in which each of the hand's markers moved, where enough frames show it."""
    tilts = []
    for marker, shape in finder.markers.items():
        corners = [hand.corners_px[marker] for hand in hands if hand and marker in hand.corners_px]
        if corners:
            offset_m = finder.string_offset_m + shape.offset_m
            tilts.append(fit_plane_tilt(camera, np.stack(corners), shape.size_m, offset_m))
    return [tilt for tilt in tilts if tilt is not None]


def movement_warnings(camera: Camera, samples: Samples, empty: np.ndarray | None, video: Path) -> list[str]:
    """Return warnings about a camera that moved; `empty` is the picture of the empty scene, if given."""
    chosen = np.unique(np.linspace(0, len(samples.pictures) - 1, MOVED_FRAMES).astype(int)).tolist()
    compared = [(samples.indices[k], find_movement(camera, eight_bit(samples.pictures[k]))) for k in chosen]
    by_markers = [(index, moved) for index, moved in compared if moved is not None]
    warnings = check_movement(by_markers, video)
    if empty is None and by_markers:
        return warnings
    quarter = max(len(samples.pictures) // 4, 1)
    before, since = pixel_median(samples.pictures[:quarter]), f"frame {samples.indices[0]}"
    if empty is not None:
        before = empty
        since = "the picture of the empty scene (take it again, or leave track.background_picture out)"
    after = pixel_median(samples.pictures[-quarter:])
    return warnings + shift_warnings(camera, before, after, samples.indices[-quarter], since)


def confidence_warnings(points_m: np.ndarray, flags: np.ndarray) -> list[str]:
    """Return warnings about points (F, n + 1, 2), or a tip, that are rarely measured without a flag."""
    sure = np.isfinite(points_m).all(axis=2) & (flags == 0)
    shares = (("the points", float(sure[:, 1:].mean())), ("the tip", float(sure[:, -1].mean())))
    return [
        f"{what}: measured without doubt in {100 * share:.0f} % of the frames; `strandcast preview` shows "
        "what the tracker detects"
        for what, share in shares
        if share < LEAST_CONFIDENT
    ]


def exposure_warnings(
    points_m: np.ndarray, time_s: np.ndarray, exposure_s: float, m_per_px: float
) -> list[str]:
    """Return a warning about an assumed exposure if points (F, n + 1, 2) are so fast that it matters."""
    interval_s = np.diff(time_s)
    speed_m_s = np.linalg.norm(np.diff(points_m, axis=0), axis=2) / interval_s[:, None]
    if not np.isfinite(speed_m_s).any():
        return []
    fastest_m_s = float(np.nanpercentile(speed_m_s, FASTEST_PERCENTILE))
    most_px = fastest_m_s * float(np.median(interval_s)) / m_per_px
    if most_px < HARMLESS_BLUR_PX:
        return []
    share_px = fastest_m_s * exposure_s / m_per_px
    return [
        f"camera.exposure_s is not given: {1e3 * exposure_s:.3g} ms is assumed, which blurs the fastest "
        f"points ({fastest_m_s:.1f} m/s) over {share_px:.1f} px; the true blur may reach {most_px:.1f} px: "
        "set it to the camera's value"
    ]


def length_warnings(clamp_fit: ClampFit, given_m: float) -> list[str]:
    """Return the warning of a length that stays as given, because hardly a frame shows the string's end."""
    if clamp_fit.frames >= LEAST_FRAMES:
        return []
    return [
        f"only {clamp_fit.frames} frames show the string's end: its length stays as given, "
        f"{1e3 * given_m:.0f} mm; if that is wrong, so are all places along it"
    ]


def length_faults(
    clamp_fit: ClampFit, given_m: float, declared_m: float, end_sigma_m: float
) -> list[RigFault]:
    """Return the fault of a string whose detected length differs from the given one.

    `given_m` is its free length as it follows from `declared_m`, which includes what is in the clamp;
    `end_sigma_m` says how well the place of its end is known.
    """
    off_m = clamp_fit.length_m - given_m
    sigma_m = float(np.hypot(clamp_fit.length_sigma_m, end_sigma_m))
    if clamp_fit.frames < LEAST_FRAMES or abs(off_m) < SIGMAS * np.hypot(sigma_m, GRASP_M):
        return []
    return [
        RigFault(
            what=f"string.length_m: {1e3 * clamp_fit.length_m:.1f} ± {1e3 * sigma_m:.1f} mm hang from the "
            f"clamp, not {1e3 * given_m:.1f} mm",
            cost="the motion was planned, and the string is fitted, with a length that is off by "
            f"{abs(off_m) / given_m:.1%}",
            fix="measure it again, with what the clamp covers. As seen, it is "
            f"{declared_m + off_m:.3f}; if the ruler confirms the declared length, check size_m and places "
            "of the plane's markers",
            field="string.length_m",
        )
    ]


def left_plane(frames: StringFrames, string: StringTrack, camera: Camera) -> OutOfPlane | None:
    """Return how far the string left the plane of motion, which one camera cannot see; None if it did not."""
    length_m = string.clamp_fit.length_m
    least_m = max(TILTED_M, TILTED_SHARE * length_m)
    return measure_out_of_plane(apparent_strings(frames, string.first.fits), length_m, camera, least_m)


def out_of_plane_warnings(out: OutOfPlane | None) -> list[str]:
    """Return a warning about a string that left the plane of motion."""
    if out is None:
        return []
    range_mm, depth_mm, error_mm = (1e3 * each_m for each_m in out)
    return [
        f"the string's apparent length varies by {range_mm:.0f} mm: its tip leaves the plane of motion by "
        f"{depth_mm:.0f} mm or more. One camera does not see that: it places the tip up to {error_mm:.0f} "
        f"mm wrong in the plane, and a miss may be {depth_mm:.0f} mm larger than it seems. Keep to one "
        "plane, or film with a second camera (docs/how-to/two-cameras.md)"
    ]


def end_sigma_m(appearance: Appearance, beyond_m: float) -> float:
    """Return how well a string's end is known along it [m], in all frames alike.

    It is seen no better than it is shaped, or not at all under a bead; `beyond_m` is the declared length of
    string beyond the middle of the last weight.
    """
    if not appearance.has_bead:
        return END_SIGMA * appearance.tip_excess_m
    return RULER_M if beyond_m < HIDES * appearance.bead_m else 0.5 * appearance.bead_m


def tip_sigma_m(along_m: float, tilts_m: Sequence[float], out: OutOfPlane | None) -> float:
    """Return the standard error of the tip, per axis, that all frames have in common [m].

    Parameters
    ----------
    along_m
        That along the string: `end_sigma_m`.
    tilts_m
        Largest error of places seen in a plane that is not the declared one, by marker of the hand.
    out
        How far the string left the plane.
    """
    depth_m = 0.0 if out is None else float(np.hypot(out.depth_m, out.tip_error_m))
    return float(np.sqrt(0.5 * along_m**2 + max(tilts_m, default=0.0) ** 2 / 3.0 + depth_m**2))
