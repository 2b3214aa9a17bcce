"""The picture of a throw: a dozen instants over the learned background, with the tracked points."""

from __future__ import annotations

import cv2
import numpy as np

from strandcast.camera.mapping import metre_to_pixel
from strandcast.camera.markers import eight_bit
from strandcast.records.camera import Camera
from strandcast.tracking.crops import View

INSTANTS = 12
FIRST_STEP_M = 0.03  # of the tip between instants, at first


class Strobe:
    """Keeps a few frames, evenly spread along the tip's path, without knowing the path's length ahead."""

    def __init__(self, background: np.ndarray) -> None:
        self.background = background
        self.frames: list[tuple[int, float, View]] = []
        self.path_m = 0.0
        self.step_m = FIRST_STEP_M
        self._tip: np.ndarray | None = None

    def offer(self, index: int, view: View | None, points_m: np.ndarray | None) -> None:
        """Keep the frame if the tip has come far enough since the last that was kept."""
        if view is None or points_m is None or not np.isfinite(points_m[-1]).all():
            return
        tip = points_m[-1]
        self.path_m += 0.0 if self._tip is None else float(np.linalg.norm(tip - self._tip))
        self._tip = tip
        if self.frames and self.path_m < self.frames[-1][1] + self.step_m:
            return
        self.frames.append((index, self.path_m, view))
        if len(self.frames) > 2 * INSTANTS:
            self.frames = self.frames[::2]
            self.step_m *= 2

    def picture(self, points_m: np.ndarray, camera: Camera) -> np.ndarray:
        """Return the composite (height, width, 3), RGB, with the points (F, n + 1, 2) of the kept frames."""
        chosen: list[int] = (
            np.unique(np.linspace(0, len(self.frames) - 1, INSTANTS).astype(int)).tolist()
            if self.frames
            else []
        )
        kept = [self.frames[k] for k in chosen]
        grey = self.background.astype(np.float32)
        most = np.zeros_like(grey)
        for _, _, view in kept:
            rows = slice(view.top, view.top + view.image.shape[0])
            columns = slice(view.left, view.left + view.image.shape[1])
            now = view.image.astype(np.float32)
            change = np.abs(now - view.background)
            newer = change > most[rows, columns]
            grey[rows, columns][newer] = now[newer]
            most[rows, columns][newer] = change[newer]
        picture = cv2.cvtColor(eight_bit(grey.astype(self.background.dtype)), cv2.COLOR_GRAY2RGB)
        for turn, (index, _, _) in enumerate(kept):
            draw_points(picture, metre_to_pixel(camera, points_m[index], camera.string_offset_m),
                        turn / max(1, len(kept) - 1))  # fmt: skip
        return picture


def draw_points(picture: np.ndarray, points_px: np.ndarray, share: float) -> None:
    """Draw the string's points (n + 1, 2) and the lines between them, from blue (first) to orange (last)."""
    first, last = np.array([70, 120, 220]), np.array([240, 140, 40])
    colour = tuple(int(c) for c in first + share * (last - first))
    good = np.isfinite(points_px).all(axis=1)
    fixed = np.where(good[:, None], np.rint(np.nan_to_num(points_px) * 16), 0).astype(np.int32)
    for i in range(len(fixed)):
        if good[i] and i + 1 < len(fixed) and good[i + 1]:
            cv2.line(picture, fixed[i].tolist(), fixed[i + 1].tolist(), colour, 1, cv2.LINE_AA, 4)
        if good[i]:
            radius = 3 if i in (0, len(fixed) - 1) else 2
            cv2.circle(picture, fixed[i].tolist(), radius * 16, colour, -1, cv2.LINE_AA, 4)
