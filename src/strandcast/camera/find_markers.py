"""Detection of the plane's markers in its photo with subpixel corners, or a diagnosis."""

from collections import Counter

import cv2
import numpy as np

from strandcast.camera.marker_sides import refine_square
from strandcast.camera.markers import (
    FAMILIES,
    SIZES,
    detect_markers,
    eight_bit,
    enough,
    marker_cells,
    marker_detector,
    same_family,
)
from strandcast.camera.pose import PlacedMarker
from strandcast.errors import StrandcastError

MIN_MARKERS = 2
MARGIN = 1.2  # cells; as far as white is looked for
LEAST_MARGIN = 0.95  # cells; with 0.6, the corners of sides of 24 px are 0.3 px off, with 0.3, 0.7
MOST_NAMED = 6  # chosen: markers in a message; a board has many
MUCH_LARGER = 5  # chosen: dictionary size over the size that is enough, from which to warn


def find_markers(
    grey: np.ndarray, wanted: dict[int, PlacedMarker], dictionary: str, file: str | None
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return the ids (k,) of the plane's markers, ascending, their corners (k, 4, 2) [px], and warnings.

    The corners are from lines fitted to each side.

    Raises
    ------
    StrandcastError
        SC-C002 an id is not in the dictionary; SC-C021 a marker appears twice; SC-C022 too few are declared;
        SC-C023 the picture is mirrored or inverted; SC-C016 another dictionary; SC-C025 too few are detected.
    """
    cells = {marker: len(marker_cells(dictionary, marker)) for marker in wanted}
    if len(wanted) < MIN_MARKERS:
        what = f"the plane has {len(wanted)} markers; at least {MIN_MARKERS} are needed"
        cost = "with a single marker, errors are about 4 mm"
        fix = "put markers at the corners of the workspace"
        raise StrandcastError("SC-C022", what, field="camera.plane.markers", cost=cost, fix=fix)
    ids, corners_px = detect_markers(grey, marker_detector(dictionary))
    mine = np.array([place for place, marker in enumerate(ids) if marker in wanted], int)
    if MIN_MARKERS <= len({*ids[mine]}) < len(wanted):
        mirrored = _detected(np.ascontiguousarray(grey[:, ::-1]), dictionary, wanted)
        if len(mirrored) > len({*ids[mine]}):  # markers of large dictionaries are others' mirror images
            raise _is_mirrored(f"found {sorted({*ids[mine].tolist()})}", mirrored, file)
    _refuse_twice(ids[mine], corners_px[mine], wanted, file)
    if len(mine) < MIN_MARKERS:
        raise _not_found(grey, wanted, dictionary, ids.tolist(), file)
    mine = mine[np.argsort(ids[mine])]
    found = ids[mine]
    refined = [
        refine_corners(grey, corners_px[place], cells[int(marker)])
        for place, marker in zip(mine, found, strict=True)
    ]
    margins = {
        int(marker): white_margin(grey, four, cells[int(marker)])
        for marker, four in zip(found, refined, strict=True)
    }
    missing = sorted(set(wanted) - set(found.tolist()))
    warnings = [f"{_listed(missing)} of the plane were not detected"] if missing else []
    return found, np.array(refined), warnings + _too_narrow(margins) + _too_large(dictionary, max(wanted))


def refine_corners(grey: np.ndarray, corners_px: np.ndarray, cells: int) -> np.ndarray:
    """Return a marker's corners (4, 2) [px] from lines along its sides; unchanged if a side is unclear."""
    refined = refine_square(eight_bit(grey), corners_px, cells)
    return refined if np.isfinite(refined).all() else corners_px


def white_margin(grey: np.ndarray, corners_px: np.ndarray, cells: int) -> float:
    """Return how far the white reaches beyond a marker's side where it is least [cells], at most `MARGIN`."""
    out = np.linspace(-0.5, MARGIN, 35)  # cells, from within the black border
    along = np.linspace(0.2, 0.8, 13)
    middle, narrowest = corners_px.mean(axis=0), MARGIN
    for start, end in zip(corners_px, np.roll(corners_px, -1, axis=0), strict=True):
        side = end - start
        normal = np.array([side[1], -side[0]]) / cells
        normal *= np.sign(normal @ (start - middle))
        places = (start + along[:, None] * side)[:, None] + out[:, None] * normal
        x, y = np.moveaxis(places.astype(np.float32), 2, 0)
        level = np.median(cv2.remap(eight_bit(grey), x, y, cv2.INTER_LINEAR), axis=0)
        white = int(np.argmax(level[out <= 1.0]))
        dark = np.flatnonzero(level[white:] < 0.5 * (level[0] + level[white]))
        if len(dark):
            narrowest = min(narrowest, float(out[white + dark[0]]))
    return narrowest


def _listed(markers: list[int]) -> str:
    return f"markers {markers}" if len(markers) <= MOST_NAMED else f"{len(markers)} markers"


def _too_narrow(margins: dict[int, float]) -> list[str]:
    """Warn of markers with too little white around them."""
    narrow = {marker: margin for marker, margin in margins.items() if margin < LEAST_MARGIN}
    if not narrow:
        return []
    return [
        f"{_listed(sorted(narrow))} have {min(narrow.values()):.1f} cells of white around them: with less "
        "than one, a corner may be a pixel off, and a marker not be detected; print them with a wider margin"
    ]


def _too_large(dictionary: str, largest: int) -> list[str]:
    """Warn if only the first few markers of a large dictionary are used: a smaller one is safer."""
    family, _, count = dictionary.rpartition("_")
    most = int(count) / MUCH_LARGER if count.isdigit() else 0
    smaller = [size for size in SIZES if largest < size <= most]
    if not smaller:
        return []
    return [
        f"{dictionary} is larger than needed: {family}_{smaller[0]} has the same markers and mistakes "
        "clutter for a marker less often"
    ]


def _refuse_twice(
    ids: np.ndarray, corners_px: np.ndarray, wanted: dict[int, PlacedMarker], file: str | None
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
        f"markers {twice} appear twice in the picture: {marker} at pixels {places}",
        file=file,
        field="camera.plane.markers",
        cost=f"they are about {apart_m * 1e3:.0f} mm apart: using the wrong one means an error of that size",
        fix="cover the one that does not belong to the plane",
    )


def _not_found(
    grey: np.ndarray, wanted: dict[int, PlacedMarker], dictionary: str, found: list[int], file: str | None
) -> StrandcastError:
    """Return why too few markers were detected: mirrored, inverted, another dictionary, other ids, none."""
    mine = sorted(set(found) & set(wanted))
    counts = f"needed {sorted(wanted)}, found {mine}"
    mirrored = _detected(np.ascontiguousarray(grey[:, ::-1]), dictionary, wanted)
    if len(mirrored) >= MIN_MARKERS:
        return _is_mirrored(counts, mirrored, file)
    if len(_detected(cv2.bitwise_not(eight_bit(grey)), dictionary, wanted)) >= MIN_MARKERS:
        fix = "export it without inversion; markers are black on white"
        return StrandcastError("SC-C023", f"the picture is a negative ({counts})", file=file, fix=fix)
    for other in FAMILIES:
        if same_family(other, dictionary):
            continue
        if len(_detected(grey, other, wanted)) >= min(MIN_MARKERS + 1, len(wanted)):
            what = f"the markers are from {''.join(enough(other, max(wanted)))}, not from {dictionary}"
            fix = "if this is a photo of the lens board, give that of the plane; else correct the dictionary"
            return StrandcastError("SC-C016", what, file=file, field="camera.plane.dictionary", fix=fix)
    others = f"; other ids detected: {sorted(set(found) - set(wanted))}" if set(found) - set(wanted) else ""
    what = f"too few markers of the plane: {counts}{others}"
    return StrandcastError("SC-C025", what, file=file, field="camera.plane.markers")


def _is_mirrored(counts: str, mirrored: list[int], file: str | None) -> StrandcastError:
    what = f"the picture is mirrored ({counts}; its mirror image shows {mirrored})"
    fix = "turn mirroring off in the camera's software, or remove the mirror"
    return StrandcastError("SC-C023", what, file=file, cost="x would point to the left", fix=fix)


def _detected(grey: np.ndarray, dictionary: str, wanted: dict[int, PlacedMarker]) -> list[int]:
    return sorted(set(detect_markers(grey, marker_detector(dictionary))[0].tolist()) & set(wanted))
