"""The truth about a filmed throw: the string's curve, the hand, hidden places, crossings."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np

from strandcast.camera.mapping import metre_per_pixel, metre_to_pixel
from strandcast.records.camera import Camera
from strandcast.records.files import atomic_write

ON_THE_STRING_M = 0.002  # spacing of the places whose visibility is stored
LEAST_SLANT = 1e-6  # least sine of the angle between crossing segments


@dataclass(frozen=True, eq=False)
class TruthArrays:
    """The arrays of truth.npz for F frames, at mid-exposure."""

    nodes_m: np.ndarray  # (F, N, 2) of the lab's chain
    places_m: np.ndarray  # (N,) of its nodes along the string, 0 at the clamp
    hand: np.ndarray  # (F, 3) x [m], y [m], direction [rad] of the clamp
    q_rad: np.ndarray  # (F, J)
    hidden: np.ndarray  # (F, D) whether arm or hand hide the string, every `ON_THE_STRING_M` from the clamp
    blur_px: np.ndarray  # (F,) distance moved by the string's fastest point in an exposure
    tip_blur_px: np.ndarray  # (F,) the same of the tip
    tip_speed_m_s: np.ndarray  # (F,)
    cnr: np.ndarray  # (K,) contrast-to-noise ratio at visible places of the string over the whole video
    weights_m: np.ndarray  # (W, 2) place and radius
    pipes_m: np.ndarray  # (P, 2) start and end
    length_m: np.ndarray  # () free length from the clamp

    def write(self, path: Path) -> None:
        """Write truth.npz."""
        with atomic_write(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **{f.name: getattr(self, f.name) for f in fields(self)})


@dataclass(frozen=True, eq=False)
class TrueCrossing:
    """A self-crossing in a frame: its two places along the string [m], the one nearer to the hand first."""

    frame: int
    first_m: float
    second_m: float


class Truth:
    """A filmed throw: its `arrays` and the `camera`."""

    def __init__(self, arrays: TruthArrays, camera: Camera) -> None:
        self.arrays = arrays
        self.camera = camera

    @classmethod
    def read(cls, folder: Path) -> Truth:
        """Read truth.npz and camera.json of a folder."""
        with np.load(folder / "truth.npz") as kept:
            arrays = TruthArrays(**{f.name: kept[f.name] for f in fields(TruthArrays)})
        return cls(arrays, Camera.read(folder / "camera.json"))

    def points_m(self, count: int) -> np.ndarray:
        """Return the mass points 1 to `count`, (F, count, 2): evenly spaced over the free length."""
        return self.at(self.shares_m(count))

    def shares_m(self, count: int) -> np.ndarray:
        """Return the mass points' places along the string, (count,)."""
        return float(self.arrays.length_m) * np.arange(1, count + 1) / count

    def at(self, places_m: np.ndarray) -> np.ndarray:
        """Return the string at places (K,) along it: (F, K, 2)."""
        k, part = self._links(places_m)
        nodes = self.arrays.nodes_m
        return np.asarray(nodes[:, k] + part[:, None] * (nodes[:, k + 1] - nodes[:, k]))

    def directions(self, places_m: np.ndarray) -> np.ndarray:
        """Return unit vectors (F, K, 2) along the string, towards the tip, at places (K,)."""
        reach = 0.5 * float(np.diff(self.arrays.places_m).min())
        length = float(self.arrays.length_m)
        step = self.at(np.minimum(places_m + reach, length)) - self.at(np.maximum(places_m - reach, 0.0))
        return np.asarray(step / np.linalg.norm(step, axis=2, keepdims=True))

    def visible(self, places_m: np.ndarray) -> np.ndarray:
        """Return whether places (K,) are inside the picture and not behind the arm, (F, K)."""
        uv = self.pixels(self.at(places_m))
        lens = self.camera.lens
        inside = ((uv >= 0) & (uv <= np.array([lens.width_px, lens.height_px]) - 1)).all(axis=2)
        return np.asarray(inside & self._clear(places_m))

    def pixels(self, places_m: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) of places (..., 2) in the plane."""
        return metre_to_pixel(self.camera, places_m, self.camera.string_offset_m)

    def metre_per_pixel(self, places_m: np.ndarray) -> np.ndarray:
        """Return the scale (...) at places (..., 2) in the plane."""
        return metre_per_pixel(self.camera, places_m, self.camera.string_offset_m)

    @cached_property
    def crossings(self) -> list[TrueCrossing]:
        """Self-crossings of all frames with both branches visible."""
        found = []
        for frame, nodes in enumerate(self.arrays.nodes_m):
            for first, second in self_crossings(nodes, self.arrays.places_m):
                if self._clear(np.array([first, second]))[frame].all():
                    found.append(TrueCrossing(frame, first, second))
        return found

    def _clear(self, places_m: np.ndarray) -> np.ndarray:
        """Return whether places (K,) are not behind the arm, (F, K)."""
        dense = np.clip(np.rint(places_m / ON_THE_STRING_M).astype(int), 0, self.arrays.hidden.shape[1] - 1)
        return np.asarray(~self.arrays.hidden[:, dense])

    def _links(self, places_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        ends = self.arrays.places_m
        k = np.clip(np.searchsorted(ends, places_m, side="right") - 1, 0, len(ends) - 2)
        return k, (places_m - ends[k]) / (ends[k + 1] - ends[k])


def self_crossings(nodes_m: np.ndarray, places_m: np.ndarray) -> list[tuple[float, float]]:
    """Return the self-crossings of a polyline (N, 2) with nodes at places (N,), as pairs of places."""
    start, step = nodes_m[:-1], np.diff(nodes_m, axis=0)
    first, second = np.triu_indices(len(step), 2)
    gap = start[second] - start[first]
    a, b = step[first], step[second]
    turn = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    # Segments of one straight line, such as a pipe's, do not cross: their turn is rounding noise.
    slant = np.abs(turn) > LEAST_SLANT * np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    turn = np.where(slant, turn, np.nan)
    on_first = (gap[:, 0] * b[:, 1] - gap[:, 1] * b[:, 0]) / turn
    on_second = (gap[:, 0] * a[:, 1] - gap[:, 1] * a[:, 0]) / turn
    hit = (on_first >= 0) & (on_first < 1) & (on_second >= 0) & (on_second < 1)
    width = np.diff(places_m)
    return [
        (float(places_m[i] + s * width[i]), float(places_m[j] + t * width[j]))
        for i, j, s, t in zip(first[hit], second[hit], on_first[hit], on_second[hit], strict=True)
    ]
