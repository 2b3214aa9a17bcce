"""What speaks against a line that was found in one picture; nothing does where it can be relied on."""

from collections.abc import Sequence

import cv2
import numpy as np

from strandcast_studies.stills.mask import Silhouette

# All chosen on the mBEST pictures, whole, cropped, covered in part and faded, and on drawn strings.
MOST_BESIDE = 0.1  # largest separate area that also looks like string, as a share of the string's area
BORDER_PX = 2  # a silhouette so near to the picture's border may continue outside
LEAST_LENGTH_WIDTHS = 10.0  # shorter objects are blobs
MOST_UNEXPLAINED = 0.04  # of the silhouette, farther from the line than a strand reaches
REACH_WIDTHS = 1.0  # half a strand's width, and as much for bends and shadows
LONGEST_GAP_WIDTHS = 4.0  # without a measured width, outside crossings
CROSSING_WIDTHS = 4.0  # around a crossing, where strands are merged
# Beyond an end: a fan of rays, in string widths; and the contrast from which something continues there.
FAN_RAD = np.radians(np.arange(-60.0, 61.0, 7.5))
FAN_FROM_WIDTHS, FAN_TO_WIDTHS = 1.5, 6.0
# Of the string's own contrast, above that at both sides of the ray. Of 35 ends faded to 12 %, 0.25 finds
# half and 0.06 all but one; without a false alarm in the whole pictures.
CONTINUES_SHARE = 0.06
CONTINUES_LEVELS = 4.0  # grey levels, at least


def doubts(
    silhouette: Silhouette,
    line: np.ndarray,
    measured: np.ndarray,
    width: float,
    places: Sequence[np.ndarray],
) -> list[str]:
    """Return why a line may not be the whole string, apart from its order at crossings.

    Parameters
    ----------
    silhouette
        That the line was found in.
    line, measured
        (K, 2) px, one pixel apart; (K,) whether the centre was measured there.
    width
        Median width of the string [px].
    places
        Crossings (2,) px.
    """
    mask = silhouette.mask
    inner = mask[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]
    found = [
        (silhouette.beside_share >= MOST_BESIDE, "other parts of the picture look like string too"),
        (inner.sum() < mask.sum(), "it touches the picture's border"),
        (len(line) < LEAST_LENGTH_WIDTHS * width, "it is too short for its width"),
        (_unexplained(mask, line, width) > MOST_UNEXPLAINED, "the line leaves a part of it out"),
        (_longest_gap(line, measured, width, places) > LONGEST_GAP_WIDTHS * width, "it has a gap"),
    ]
    if silhouette.contrast is not None:
        ends = {"first": line[::-1], "last": line}
        found += [
            (_continues(silhouette.contrast, towards, width), f"something continues beyond its {name} end")
            for name, towards in ends.items()
        ]
    return [words for true, words in found if true]


def _unexplained(mask: np.ndarray, line: np.ndarray, width: float) -> float:
    """Return the share of a mask that is farther from the line than a strand reaches."""
    free = np.ones(mask.shape, np.uint8)
    cv2.polylines(free, [np.rint(line).astype(np.int32)], False, 0)
    far = cv2.distanceTransform(free, cv2.DIST_L2, 5) > REACH_WIDTHS * width
    return float((mask & far).sum() / mask.sum())


def _longest_gap(line: np.ndarray, measured: np.ndarray, width: float, places: Sequence[np.ndarray]) -> int:
    """Return the longest run of points that are not measured, in pixels, outside crossings."""
    known = measured.copy()
    for place in places:
        known |= np.linalg.norm(line - place, axis=1) < CROSSING_WIDTHS * width
    edges = np.flatnonzero(np.diff(np.r_[False, ~known, False].astype(int)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _continues(contrast: np.ndarray, line: np.ndarray, width: float) -> bool:
    """Return whether a strand, fainter or after a gap, continues beyond the last point of a line."""
    back = min(len(line) - 1, max(3, round(2.0 * width)))
    ahead = line[-1] - line[-1 - back]
    heading = np.arctan2(ahead[1], ahead[0]) + FAN_RAD
    rays = np.column_stack([np.cos(heading), np.sin(heading)])
    far = width * np.arange(FAN_FROM_WIDTHS, FAN_TO_WIDTHS, 0.25)
    places = line[-1] + far[:, None, None] * rays
    aside = 1.5 * width * np.column_stack([-rays[:, 1], rays[:, 0]])
    on, left, right = (
        _sampled(contrast, each).mean(axis=0) for each in (places, places + aside, places - aside)
    )
    own = float(np.median(_sampled(contrast, line)))
    return bool((on - np.maximum(left, right)).max() > max(CONTINUES_SHARE * own, CONTINUES_LEVELS))


def _sampled(field: np.ndarray, places: np.ndarray) -> np.ndarray:
    at = places.reshape(-1, 1, 2).astype(np.float32)
    values = cv2.remap(field, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values).reshape(places.shape[:-1])
