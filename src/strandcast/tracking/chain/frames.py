"""The frames of a video as the string tracker reads them: search window, time, hand and clamp."""

from dataclasses import dataclass

import numpy as np

from strandcast.tracking.chain.search_window import HandBox, SearchWindow
from strandcast.tracking.crops import Crops
from strandcast.tracking.hand.path import TrackedHand
from strandcast.tracking.hand.rigid import place


@dataclass(frozen=True, eq=False)
class FrameInput:
    """One frame: search window, time, the hand's direction, where the string leaves the clamp (2,) [m]."""

    window: SearchWindow
    time_s: float
    hand_rad: float
    clamp_m: np.ndarray


@dataclass(frozen=True, eq=False)
class StringFrames:
    """A video's frames. Several threads may read them at a time."""

    crops: Crops
    background: np.ndarray  # the empty scene (height, width)
    hand: TrackedHand
    time_s: np.ndarray  # (F,)
    hand_extent_m: np.ndarray  # low x, low y, high x, high y of the hand in its own frame, (4,)
    lateral_offset_m: float = 0.0  # where the string leaves the clamp, to the left of its middle

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.hand.pose)

    def clamp_m(self, index: int) -> np.ndarray:
        """Return where the string leaves the clamp in a frame, (2,)."""
        return np.asarray(place(self.hand.pose[index], np.array([[0.0, self.lateral_offset_m]]))[0])

    def at(self, index: int) -> FrameInput | None:
        """Return a frame; None if its hand is unknown."""
        crop, pose = self.crops.at(index), self.hand.pose[index].array()
        if crop is None or not np.isfinite(pose).all():
            return None
        box = HandBox(*pose.tolist(), *self.hand_extent_m.tolist())
        window = SearchWindow(*crop, self.background, self.crops.plane, box)
        return FrameInput(window, float(self.time_s[index]), float(pose[2]), self.clamp_m(index))

    def window(self, index: int) -> SearchWindow | None:
        """Return a frame's search window; None if its hand is unknown."""
        frame = self.at(index)
        return None if frame is None else frame.window
