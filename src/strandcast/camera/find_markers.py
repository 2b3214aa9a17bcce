"""The plane's markers in its photo, with sub-pixel corners; or what is wrong where they are not found."""

from __future__ import annotations

from collections import Counter

import cv2
import numpy as np

from strandcast.camera.markers import (
    FAMILIES,
    detect_markers,
    eight_bit,
    marker_cells,
    marker_detector,
    same_family,
)
from strandcast.camera.pose import PlaneMarker
from strandcast.camera.square import refine_square
from strandcast.errors import StrandcastError

LEAST_MARKERS = 2
SMALLER = (50, 100, 250)
MUCH_LARGER = 5


def find_markers(
    grey: np.ndarray, wanted: dict[int, PlaneMarker], dictionary: str, file: str | None
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Find the plane's markers.

    Returns
    -------
    ids : ndarray (k,)
        Ascending.
    corners_px : ndarray (k, 4, 2)
        From lines along each side.
    warnings : list of str

    Raises
    ------
    StrandcastError
        SC-C003 an id that the dictionary does not have; SC-C021 one is there twice; SC-C022 to SC-C025 too
        few of them: placed, mirrored, of another dictionary, inverted or not there.
    """
    cells = {marker: len(marker_cells(dictionary, marker)) for marker in wanted}
    if len(wanted) < LEAST_MARKERS:
        raise StrandcastError(
            "SC-C022",
            f"the plane has {len(wanted)} markers, at least {LEAST_MARKERS} are needed",
            field="camera.plane.markers",
            cost="one marker alone leaves about 4 mm of error",
            fix="put markers at the corners of the space of the throw",
        )
    ids, corners_px = detect_markers(grey, marker_detector(dictionary))
    mine = np.array([place for place, marker in enumerate(ids) if marker in wanted], int)
    _refuse_twice(ids[mine], corners_px[mine], wanted, file)
    if len(mine) < LEAST_MARKERS:
        raise _not_found(grey, wanted, dictionary, ids.tolist(), file)
    mine = mine[np.argsort(ids[mine])]
    found = ids[mine]
    refined = [
        refine_corners(grey, corners_px[place], cells[int(marker)])
        for place, marker in zip(mine, found, strict=True)
    ]
    missing = sorted(set(wanted) - set(found.tolist()))
    warnings = [f"markers {missing} of the plane were not seen"] if missing else []
    return found, np.array(refined), warnings + _too_large(dictionary, max(wanted))


def refine_corners(grey: np.ndarray, corners_px: np.ndarray, cells: int) -> np.ndarray:
    """Return a marker's corners (4, 2) [px] from lines along its sides; as found where unclear."""
    refined = refine_square(eight_bit(grey), corners_px, cells)
    return refined if np.isfinite(refined).all() else corners_px


def _too_large(dictionary: str, largest: int) -> list[str]:
    """Warn of a dictionary of which only the first few markers are used: a smaller one is safer."""
    family, _, count = dictionary.rpartition("_")
    smaller = [size for size in SMALLER if count.isdigit() and largest < size <= int(count) / MUCH_LARGER]
    if not smaller:
        return []
    return [
        f"{dictionary} is larger than the ids need: {family}_{smaller[0]} has the same markers, and takes "
        "clutter for a marker less often"
    ]


def _refuse_twice(
    ids: np.ndarray, corners_px: np.ndarray, wanted: dict[int, PlaneMarker], file: str | None
) -> None:
    twice = sorted(marker for marker, count in Counter(ids.tolist()).items() if count > 1)
    if not twice:
        return
    marker = twice[0]
    centres = corners_px[ids == marker].mean(axis=1)
    side_px = np.linalg.norm(np.diff(corners_px[ids == marker][0], axis=0), axis=1).mean()
    apart_m = wanted[marker].size_m * np.linalg.norm(centres[1] - centres[0]) / side_px
    places = " and ".join(f"({u:.0f}, {v:.0f})" for u, v in centres)
    raise StrandcastError(
        "SC-C021",
        f"markers {twice} are in the picture twice: {marker} at pixels {places}",
        file=file,
        field="camera.plane.markers",
        cost=f"they lie some {apart_m * 1e3:.0f} mm apart: the wrong one would be off by as much",
        fix="cover the one that does not belong to the plane",
    )


def _not_found(
    grey: np.ndarray, wanted: dict[int, PlaneMarker], dictionary: str, found: list[int], file: str | None
) -> StrandcastError:
    """Say why too few markers were seen: mirrored or inverted, of another dictionary, other ids, or none."""
    mine = sorted(set(found) & set(wanted))
    needed = f"needed {sorted(wanted)}, found {mine}"
    mirrored = _seen(np.ascontiguousarray(grey[:, ::-1]), dictionary, wanted)
    if len(mirrored) >= LEAST_MARKERS:
        return StrandcastError(
            "SC-C023",
            f"the picture is mirrored ({needed}; its mirror image shows {mirrored})",
            file=file,
            cost="x would run to the left",
            fix="turn mirroring off in the camera's software, or take the mirror away",
        )
    if len(_seen(cv2.bitwise_not(eight_bit(grey)), dictionary, wanted)) >= LEAST_MARKERS:
        return StrandcastError(
            "SC-C023",
            f"the picture is a negative ({needed})",
            file=file,
            fix="export it as the camera saw it; markers are black on white",
        )
    for other in FAMILIES:
        if same_family(other, dictionary):
            continue
        if len(_seen(grey, other, wanted)) >= min(LEAST_MARKERS + 1, len(wanted)):
            return StrandcastError(
                "SC-C024",
                f"the markers are of {other} or a part of it, not of {dictionary}",
                file=file,
                field="camera.plane.dictionary",
                fix="correct the dictionary",
            )
    others = f"; other ids seen: {sorted(set(found) - set(wanted))}" if set(found) - set(wanted) else ""
    return StrandcastError(
        "SC-C025",
        f"too few markers of the plane: {needed}{others}",
        file=file,
        field="camera.plane.markers",
        fix="check ids, focus and light; white paper must surround each black square",
    )


def _seen(grey: np.ndarray, dictionary: str, wanted: dict[int, PlaneMarker]) -> list[int]:
    return sorted(set(detect_markers(grey, marker_detector(dictionary))[0].tolist()) & set(wanted))
