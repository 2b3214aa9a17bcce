"""Twenty pictures of one cable that crosses itself: mBEST's S1, with masks; the order judged by eye.

`mbest_s1_orders.json` holds, for each picture, places that the cable passes one after the other and the
crossings, read off the pictures by eye before any program had ordered them: at least one place on every
branch between crossings and two or more on every loop, so that each wrong pairing puts a place out of turn.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from skimage.morphology import skeletonize

from strandcast.errors import StrandcastError
from strandcast.evidence.figure import Figure
from strandcast.tracking.still import StillString, string_in_mask, string_in_picture

ORDERS = Path(__file__).with_name("mbest_s1_orders.json")
NEAR_PX = 12.0  # of a place read by eye to the centreline; the cable is 10 to 16 px wide
CROSSING_NEAR_PX = 15.0
WRONG_TARGET = 1.0  # of twenty
OUTSIDE_TARGET_PERCENT = 0.1
FROM_AXIS_TARGET_PX = 0.5


@dataclass(frozen=True, eq=False)
class Judged:
    """What the eye saw in a picture: the way (N, 2) along the cable and the crossings (C, 2), px."""

    way_px: np.ndarray
    crossings_px: np.ndarray


@cache
def judged_orders() -> dict[str, Judged]:
    """Return what the eye saw, by the picture's name."""
    orders = json.loads(ORDERS.read_text())
    return {
        name: Judged(np.array(order["way_px"], float), np.array(order["crossings_px"], float))
        for name, order in orders.items()
    }


def read_mask(folder: Path, name: str) -> np.ndarray:
    """Return a picture's mask (896, 672) bool."""
    path = folder / f"{name}_gt.png"
    mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if mask is None:
        raise FileNotFoundError(2, "not an image", str(path))
    return np.asarray(mask > 127)


def read_picture(folder: Path, name: str) -> np.ndarray:
    """Return a picture (896, 672, 3)."""
    path = folder / f"{name}.jpg"
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise FileNotFoundError(2, "not an image", str(path))
    return np.asarray(picture)


def order_faults(string: StillString, judged: Judged) -> list[str]:
    """Return what differs from the order seen by eye; empty where the order is right."""
    faults = []
    apart = np.linalg.norm(judged.way_px[:, None] - string.line_px[None], axis=2)
    for place, distance in zip(judged.way_px, apart.min(axis=1), strict=True):
        if distance > NEAR_PX:
            faults.append(f"({place[0]:.0f}, {place[1]:.0f}) is {distance:.0f} px from the line")
    along = apart.argmin(axis=1)
    rising = np.diff(along)
    if not ((rising > 0).all() or (rising < 0).all()):
        faults.append(f"the places are passed at {along.tolist()} px")
    found = np.array([crossing.place_px for crossing in string.crossings]).reshape(-1, 2)
    if len(found) != len(judged.crossings_px):
        faults.append(f"{len(found)} crossings instead of {len(judged.crossings_px)}")
    elif (
        np.linalg.norm(judged.crossings_px[:, None] - found[None], axis=2).min(axis=1) > CROSSING_NEAR_PX
    ).any():
        faults.append("a crossing is in another place")
    return faults


def from_axis_px(string: StillString, mask: np.ndarray) -> np.ndarray:
    """Distances (K,) of the measured points to the nearest pixel of the mask's medial axis, px."""
    off_axis = (~skeletonize(mask)).astype(np.uint8)
    distance = cv2.distanceTransform(off_axis, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    line = string.line_px[string.measured].astype(np.float32)
    return np.asarray(cv2.remap(distance, line[:, 0], line[:, 1], cv2.INTER_LINEAR)).ravel()


def outside_percent(string: StillString, mask: np.ndarray) -> float:
    """Share of the centreline's points that are not on the mask (%)."""
    column, row = np.rint(string.line_px).astype(int).T
    inside = (row >= 0) & (column >= 0) & (row < mask.shape[0]) & (column < mask.shape[1])
    inside[inside] = mask[row[inside], column[inside]]
    return float(100.0 * (1.0 - inside.mean()))


def measure(folder: Path) -> list[Figure]:
    """Figures over all pictures: from the mask given, and from the picture alone."""
    cpu_ms, outside, off_axis, margins = {}, {}, [], {}
    wrong: dict[str, dict[str, list[str]]] = {"mask": {}, "picture": {}}
    from_mask: dict[str, StillString] = {}
    first = next(iter(judged_orders()))
    string_in_mask(read_mask(folder, first))  # compiles
    for name, judged in judged_orders().items():
        mask = read_mask(folder, name)
        begun = time.process_time()
        string = string_in_mask(mask)
        cpu_ms[name] = 1e3 * (time.process_time() - begun)
        from_mask[name] = string
        outside[name] = outside_percent(string, mask)
        off_axis.append(from_axis_px(string, mask))
        margins[name] = [crossing.margin for crossing in string.crossings]
        wrong["mask"][name] = order_faults(string, judged)
    apart = []
    for name, judged in judged_orders().items():
        try:
            string = string_in_picture(read_picture(folder, name))
        except StrandcastError as problem:
            wrong["picture"][name] = [problem.what]
            continue
        wrong["picture"][name] = order_faults(string, judged)
        gaps = np.linalg.norm(string.line_px[:, None] - from_mask[name].line_px[None], axis=2)
        apart.append(gaps.min(axis=1))
    axis = np.concatenate(off_axis)
    return [
        _wrong("mbest_s1.orders_wrong", wrong["mask"], "masks given"),
        _wrong("mbest_s1.orders_wrong_from_picture", wrong["picture"], "mask found by the program"),
        Figure("mbest_s1.outside_mask", max(outside.values()), "%", OUTSIDE_TARGET_PERCENT,
               "points of the centreline beside the mask: the worst picture", {"percent": outside}),
        Figure("mbest_s1.from_medial_axis", float(np.median(axis)), "px", FROM_AXIS_TARGET_PX,
               "median; the axis is of whole pixels, which alone makes about 0.25 px",
               {"p95_px": float(np.percentile(axis, 95)), "most_px": float(axis.max())}),
        Figure("mbest_s1.picture_against_mask", float(np.median(np.concatenate(apart))), "px",
               note="centreline from the picture alone against the mask's, median",
               detail={"p95_px": float(np.percentile(np.concatenate(apart), 95))}),
        Figure("mbest_s1.least_margin", min(m for each in margins.values() for m in each), "1",
               note="bending by which another order is dearer, in units of the usual; 6 counts as sure",
               detail={"margins": margins}),
        Figure("mbest_s1.cpu", float(np.median(list(cpu_ms.values()))), "ms",
               note="CPU time per picture of 896 × 672, mask given, all threads; median",
               detail={"most_ms": max(cpu_ms.values())}),
    ]  # fmt: skip


def _wrong(name: str, faults: dict[str, list[str]], how: str) -> Figure:
    """Figure of the pictures ordered wrong."""
    bad = {picture: what for picture, what in faults.items() if what}
    note = f"pictures of {len(faults)} not ordered as judged by eye; {how}"
    return Figure(name, float(len(bad)), "1", WRONG_TARGET, note, {"faults": bad} if bad else None)
