"""The frames of a video as the string tracker reads them: search window, time, hand, clamp and beads."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from strandcast.tracking.chain.search_window import HandBox, SearchWindow
from strandcast.tracking.crops import Crops
from strandcast.tracking.hand.path import TrackedHand
from strandcast.tracking.hand.rigid import place


@dataclass(frozen=True, eq=False)
class FrameInput:
    """One frame: search window, time, clamp and beads.

    The string leaves the clamp at `clamp_m` (2,). Its beads are at `bead_m` (B, 2), NaN where one was not
    found; None before they are known.
    """

    window: SearchWindow
    time_s: float
    clamp_m: np.ndarray
    bead_m: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class GivenPlaces:
    """Places of P points of the string that need no search: of a second held end, and corrections by hand."""

    share: np.ndarray  # where on the string, as a share of its length, (P,)
    place_m: np.ndarray  # (F, P, 2); NaN where one is not given
    corrected: tuple[int, ...] = ()  # frames, ascending

    def far_m(self) -> np.ndarray | None:
        """Return the places (F, 2) of the string's other end; None if they are not given in every frame."""
        always = (self.share == 1.0) & np.isfinite(self.place_m).all(axis=(0, 2))
        return self.place_m[:, int(np.argmax(always))] if always.any() else None


@dataclass(frozen=True, eq=False)
class StringFrames:
    """A video's frames. Several threads may read them at a time."""

    crops: Crops
    background: np.ndarray  # the empty scene (height, width)
    hand: TrackedHand
    time_s: np.ndarray  # (F,)
    hand_extent_m: np.ndarray  # low x, low y, high x, high y of the hand in its own frame, (4,)
    lateral_offset_m: float = 0.0  # where the string leaves the clamp, to the left of its middle
    given: GivenPlaces | None = None
    beads_m: np.ndarray | None = (
        None  # where given places and beads are, (F, B, 2); None before they are known
    )

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.hand.pose)

    def with_given(self, beads: int, *, corrected: bool) -> StringFrames:
        """Return the frames with the given places as the first of so many beads.

        Those that are given in some frames only, the corrections, are among them if `corrected`.
        """
        if self.given is None:
            return self
        place_m, count = self.given.place_m, len(self.given.share)
        beads_m = np.full((len(self), beads, 2), np.nan)
        wanted = np.full(count, corrected) | np.isfinite(place_m).all(axis=(0, 2))
        beads_m[:, :count] = np.where(wanted[:, None], place_m, np.nan)
        return replace(self, beads_m=beads_m)

    def clamp_m(self, index: int) -> np.ndarray:
        """Return where the string leaves the clamp in a frame, (2,)."""
        return self._clamps_m[index]

    @cached_property
    def _clamps_m(self) -> list[np.ndarray]:
        clamp_m = np.array([[0.0, self.lateral_offset_m]])
        return [place(self.hand.pose[index], clamp_m)[0] for index in range(len(self))]

    @cached_property
    def _boxes(self) -> list[HandBox | None]:
        poses, extent_m = self.hand.pose.array(), self.hand_extent_m.tolist()
        known = np.isfinite(poses).all(axis=1).tolist()
        return [
            HandBox(*pose, *extent_m) if k else None for pose, k in zip(poses.tolist(), known, strict=True)
        ]

    def at(self, index: int) -> FrameInput | None:
        """Return a frame; None if its hand is unknown."""
        crop, box = self.crops.at(index), self._boxes[index]
        if crop is None or box is None:
            return None
        window = SearchWindow(*crop, self.background, self.crops.plane, box)
        bead_m = None if self.beads_m is None else self.beads_m[index]
        return FrameInput(window, float(self.time_s[index]), self.clamp_m(index), bead_m)

    def window(self, index: int) -> SearchWindow | None:
        """Return a frame's search window; None if its hand is unknown."""
        frame = self.at(index)
        return None if frame is None else frame.window
