"""The median width along the string, and the string's own width."""

from dataclasses import dataclass

import numpy as np
import scipy

LEAST_VISIBLE = 0.4  # share of the frames in which a place must be visible
AGREE = 0.25  # half of the frames must lie within this share of the local width, or of the string's
SLIDE_M = 0.012  # distance within which the largest width counts as the local one
SHORTEST_SECTION_M = 0.036  # a shorter bump is a weight, a longer one a section
SHORTEST_SECTION_PX = 16.0


@dataclass(frozen=True)
class Profile:
    """The median width along the string, and its standard error, (K,) [m]; NaN where unknown."""

    places_m: np.ndarray
    width_m: np.ndarray
    error_m: np.ndarray


def median_profile(places_m: np.ndarray, widths_m: np.ndarray, agree: float = AGREE) -> Profile:
    """Return the median over frames (F, K), where enough of them show the place and agree about it."""
    count = np.isfinite(widths_m).sum(axis=0)
    known = (count >= 3) & (count >= LEAST_VISIBLE * count.max(initial=0))
    width, error = np.full(len(places_m), np.nan), np.full(len(places_m), np.nan)
    if known.any():
        low, width[known], high = _quartiles(widths_m[:, known], count[known])
        error[known] = 0.93 * (high - low) / np.sqrt(count[known])
        # On a ball's steep flanks frames differ because the chain slides; beyond the tip is only noise.
        near = int(SLIDE_M / (places_m[1] - places_m[0])) | 1
        usual = scipy.ndimage.maximum_filter1d(np.fmax(width, np.nanmedian(width)), near, mode="nearest")
        width[known] = np.where(high - low > 2 * agree * usual[known], np.nan, width[known])
    return Profile(places_m, _longest_part(width), error)


def _quartiles(widths_m: np.ndarray, count: np.ndarray) -> list[np.ndarray]:
    """Return the quartiles (3 of K) of columns with `count` numbers; numpy's own for NaN is far slower."""
    ranked = np.sort(widths_m, axis=0)  # NaN come last
    columns = np.arange(len(count))
    found = []
    for share in (0.25, 0.5, 0.75):
        place = share * (count - 1)
        low = place.astype(int)
        high = np.minimum(low + 1, count - 1)
        found.append(ranked[low, columns] + (place - low) * (ranked[high, columns] - ranked[low, columns]))
    return found


def _longest_part(width: np.ndarray) -> np.ndarray:
    """Keep the longest stretch without larger holes: near the hand, a few places may agree by chance."""
    parts, count = scipy.ndimage.label(closed(np.isfinite(width), 7))
    if count < 2:
        return width
    longest = 1 + int(np.argmax([(parts == 1 + part).sum() for part in range(count)]))
    return np.where(parts == longest, width, np.nan)


def closed(mask: np.ndarray, places: int) -> np.ndarray:
    """Return a mask (K,) in which holes shorter than `places` are closed."""
    padded = np.pad(mask, places)
    return np.asarray(scipy.ndimage.binary_closing(padded, np.ones(places, dtype=bool))[places:-places])


def own_width(profile: Profile, length_m: float) -> float:
    """Return the string's own width [m]: the median of that half of all widths with the smallest range."""
    on_it = np.isfinite(profile.width_m) & (profile.places_m < length_m)
    widths = np.sort(profile.width_m[on_it])
    if len(widths) < 20:
        return float("nan")
    half = len(widths) // 2
    first = int(np.argmin(widths[half:] - widths[: len(widths) - half]))
    return float(np.median(widths[first : first + half + 1]))


def shortest_section_m(metre_per_pixel: float) -> float:
    """Return the least length of a section [m]."""
    return max(SHORTEST_SECTION_M, SHORTEST_SECTION_PX * metre_per_pixel)


def without_bumps(profile: Profile, metre_per_pixel: float) -> np.ndarray:
    """Return the width (K,) without bumps shorter than a section; unknown places are interpolated."""
    known = np.isfinite(profile.width_m)
    bridged = np.interp(profile.places_m, profile.places_m[known], profile.width_m[known])
    step_m = profile.places_m[1] - profile.places_m[0]
    smooth = scipy.ndimage.median_filter(bridged, 5, mode="nearest")
    size = int(shortest_section_m(metre_per_pixel) / step_m) | 1
    return np.asarray(scipy.ndimage.grey_opening(smooth, (size,), mode="nearest"))
