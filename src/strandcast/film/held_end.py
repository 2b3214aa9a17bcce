"""The held ends of a string through a film: still, followed, or with a marker."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from strandcast.camera.mapping import pixel_to_metre
from strandcast.camera.markers import (
    corners_of,
    detect_markers,
    eight_bit,
    marker_detector,
    marker_side_px,
)
from strandcast.core.hand_marker import HandMarker
from strandcast.core.pose import Pose, rotated
from strandcast.errors import StrandcastError
from strandcast.film.known import HeldEnd
from strandcast.film.seen import SPREAD_SHARE, SeenString, agreed_ends
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.tracking.decoding import HeldEndFinder
from strandcast.tracking.hand.finder import HandDetection, HandFinder
from strandcast.tracking.hand.rigid import fit_rigid

# Chosen on drawn films.
HOLDER_SHARE = 0.042  # of the picture's height: half the side of the pattern by which a held end is followed
REACH_SHARE = 0.035  # of it, by which the held end may be off its expected place from frame to frame
LEAST_ALIKE = 0.65  # correlation with the first frame's pattern, below which a held end is not found
SIGMA_PX = 1.0  # of a held end


@dataclass(frozen=True, eq=False)
class FilmScene:
    """A film before its string is tracked: pictures spread over it, and the camera."""

    video: Path  # as the user named it
    file: Path  # that is tracked: the same, or made of it by colour
    facts: VideoFacts
    pictures: list[np.ndarray]
    seen: SeenString
    camera: Camera

    def metres(self, places_px: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) in the string's plane [m]."""
        flat = pixel_to_metre(self.camera, np.reshape(places_px, (-1, 2)), self.camera.string_offset_m)
        return np.asarray(flat).reshape(np.shape(places_px))


def held_ends(scene: FilmScene, held: Sequence[HeldEnd], dictionary: str) -> tuple[list[HeldEndFinder], str]:
    """Return what finds the held end, or both, in each frame, and how they are known, in words.

    Raises
    ------
    StrandcastError
        SC-T004 none is given, and the frames agree on none; SC-W021 more than two are given.
    """
    spread_px = SPREAD_SHARE * float(np.hypot(scene.facts.width_px, scene.facts.height_px))
    if len(held) > 2:
        what = f"{len(held)} held ends are given, and a string has two"
        raise StrandcastError("SC-W021", what, field="held", fix="give one or two")
    ends: list[HeldEndFinder] = []
    size_px = (scene.facts.width_px, scene.facts.height_px)
    for one in held:
        if one.place_px is not None and not all(
            0 <= x < s for x, s in zip(one.place_px, size_px, strict=True)
        ):
            what = f"{one.place_px} is outside of the picture of {size_px[0]} x {size_px[1]} px"
            raise StrandcastError("SC-W021", what, file=scene.video, field="held", fix="give a pixel in it")
        if one.marker is not None:
            ends.append(_end_at_marker(scene, one, one.marker, dictionary, spread_px))
        else:
            kind = FollowedEnd if one.moves else FixedEnd
            ends.append(kind(scene.camera, np.array(one.place_px), scene.seen.middle_px))
    if held:
        return ends, "; ".join(one.words() for one in held)
    agreed = sorted(agreed_ends(scene.seen.ends_px, spread_px), key=lambda place: float(place[1]))
    if not agreed:
        raise not_held(scene, "the frames do not agree on a place")
    at = " and ".join(f"({u:.0f}, {v:.0f})" for u, v in agreed)
    both = ": both ends are held, point 0 is the upper" if len(agreed) == 2 else ""
    ends += [FixedEnd(scene.camera, place, scene.seen.middle_px) for place in agreed]
    return ends, f"found where the frames agree, at {at} px{both}"


def not_held(scene: FilmScene, why: str) -> StrandcastError:
    """Return the error for a held end that is not known."""
    return StrandcastError(
        "SC-T004",
        f"where is the string held? {why}",
        file=scene.video,
        fix="give the pixel: --held 640,120; if it moves --held moving:640,120 with its pixel in the first "
        "frame; with a marker on what holds it --held marker:7",
    )


def _end_at_marker(
    scene: FilmScene, held: HeldEnd, marker: int, dictionary: str, spread_px: float
) -> HandFinder:
    """Return the finder of a held end that moves with a marker."""
    detector, px_m = marker_detector(dictionary), scene.camera.scale_m_per_px
    side_m, poses = (marker_side_px(scene.pictures, dictionary, [marker]) or 0.0) * px_m, {}
    for k, picture in enumerate(scene.pictures):
        ids, corners = detect_markers(np.ascontiguousarray(eight_bit(picture)), detector)
        for four in corners[ids == marker]:
            poses[k] = fit_rigid(corners_of(side_m), scene.metres(four))[0]
    if not poses:
        raise not_held(scene, f"marker {marker} of {dictionary} is in none of the pictures")
    if held.place_px is not None:
        if 0 not in poses:
            raise not_held(scene, f"marker {marker} is not seen in the first frame, where its pixel is")
        places_m = [_in_frame_of(poses[0], scene.metres(np.array(held.place_px)))]
    else:
        both = zip(scene.seen.shown.tolist(), scene.seen.ends_px, strict=True)
        ends_m = [_in_frame_of(poses[k], scene.metres(ends)) for k, ends in both if k in poses]
        places_m = agreed_ends(np.array(ends_m).reshape(-1, 2, 2), spread_px * px_m)
        if not places_m:
            raise not_held(scene, f"the frames do not agree on a place beside marker {marker}")
    shape = HandMarker(marker, side_m, (-float(places_m[0][0]), -float(places_m[0][1])))
    return HandFinder(scene.camera, [shape], dictionary, scene.camera.string_offset_m)


def _in_frame_of(pose: Pose, places_m: np.ndarray) -> np.ndarray:
    """Return places (..., 2) in a pose's own frame."""
    return np.asarray(rotated(places_m - pose.position_m, -np.asarray(pose.angle_rad)))


class BothEnds:
    """Finds the first end in one frame after another, and notes the second, if there is one."""

    def __init__(self, ends: Sequence[HeldEndFinder]) -> None:
        self.camera = ends[0].camera
        self.ends = ends
        self.far_m: list[np.ndarray] = []  # a place (2,) for each frame, NaN where it was not found

    def find(self, image: np.ndarray) -> HandDetection | None:
        """Return the first end in the next frame."""
        for other in self.ends[1:]:
            found = other.find(image)
            self.far_m.append(np.full(2, np.nan) if found is None else found.pose.position_m)
        return self.ends[0].find(image)


class FixedEnd:
    """A held end that stays at one pixel."""

    def __init__(self, camera: Camera, place_px: np.ndarray, toward_px: np.ndarray) -> None:
        self.camera = camera
        self.place_px = np.asarray(place_px, dtype=float)
        across, down = np.subtract(toward_px, place_px)
        self.angle_rad = float(np.arctan2(-down, across))

    def find(self, image: np.ndarray) -> HandDetection | None:
        """Return the held end in the next frame."""
        place_m = pixel_to_metre(self.camera, self.place_px[None], self.camera.string_offset_m)[0]
        sigma_m = SIGMA_PX * self.camera.scale_m_per_px
        return HandDetection(Pose(place_m, np.array(self.angle_rad)), sigma_m, 0.0, {})


class FollowedEnd(FixedEnd):
    """A held end that moves: the pattern around its pixel in the first frame is followed.

    What holds it may not turn far; a holder that turns carries a marker.
    """

    def __init__(self, camera: Camera, place_px: np.ndarray, toward_px: np.ndarray) -> None:
        super().__init__(camera, place_px, toward_px)
        height = camera.lens.height_px
        self._half, self._reach = (max(8, round(share * height)) for share in (HOLDER_SHARE, REACH_SHARE))
        self._pattern: np.ndarray | None = None
        self._step_px = np.zeros(2)

    def find(self, image: np.ndarray) -> HandDetection | None:
        """Return the held end in the next frame; None where nothing is like the pattern."""
        pad, side = self._half + self._reach + 1, 2 * self._half + 1
        padded = cv2.copyMakeBorder(eight_bit(image), pad, pad, pad, pad, cv2.BORDER_REPLICATE)
        if self._pattern is None:
            self._pattern = cv2.getRectSubPix(padded, (side, side), tuple(self.place_px + pad))
            return super().find(image)
        edge = np.array(image.shape[1::-1]) - 1
        u, v = np.rint(np.clip(self.place_px + self._step_px, 0, edge)).astype(int) + pad
        reach = self._half + self._reach
        alike = cv2.matchTemplate(
            padded[v - reach : v + reach + 1, u - reach : u + reach + 1], self._pattern, cv2.TM_CCOEFF_NORMED
        )
        _, likeness, _, place = cv2.minMaxLoc(alike)
        if likeness < LEAST_ALIKE:
            return None
        best = np.array(place)
        place_px = np.array([u, v]) - pad + best - self._reach + peak_shift(alike, best)
        self._step_px = 0.5 * (self._step_px + place_px - self.place_px)
        self.place_px = place_px
        return super().find(image)


def peak_shift(values: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """Return how far (2,) a peak is from its pixel (x, y), by a parabola along each axis."""
    x, y = peak
    shift = np.zeros(2)
    for axis, (line, at) in enumerate(((values[y], x), (values[:, x], y))):
        if 0 < at < len(line) - 1:
            before, here, after = line[at - 1 : at + 2]
            bend = before - 2.0 * here + after
            shift[axis] = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return shift
