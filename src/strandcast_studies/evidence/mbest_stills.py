"""Twenty pictures of one cable that crosses itself: mBEST's S1, with masks and hand-labelled orders.

`mbest_s1_orders.json` holds, for each picture, places along the cable in order and the crossings, labelled by
eye before any program had ordered them: at least one place on every branch between crossings and two or more
on every loop, so that each wrong pairing puts a place out of order.
"""

import json
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from skimage.morphology import skeletonize

from strandcast.errors import StrandcastError
from strandcast_studies.evidence.figure import Figure
from strandcast_studies.stills.centreline import StillString, string_in_mask, string_in_picture
from strandcast_studies.stills.mask import read_image

ORDERS = Path(__file__).with_name("mbest_s1_orders.json")
NEAR_PX = 12.0  # tolerance from a labelled place to the centreline; the cable is 10 to 16 px wide
CROSSING_NEAR_PX = 15.0  # likewise, of a crossing
WRONG_NOTE = "pictures of 20 with another order than labelled by eye; "
# Unit, target (chosen) and note of each figure.
FIGURES: dict[str, tuple[str, float | None, str]] = {
    "orders_wrong": ("1", 1.0, WRONG_NOTE + "from the given masks"),
    "orders_wrong_from_picture": ("1", 1.0, WRONG_NOTE + "mask found by the program"),
    "outside_mask": ("%", 0.1, "points of the centreline outside the mask, in the worst picture"),
    "from_medial_axis": (
        "px",
        0.5,
        "median; the axis consists of whole pixels, which alone gives about 0.25 px",
    ),
    "picture_against_mask": ("px", None, "centreline from the picture alone against the mask's, median"),
    "least_margin": (
        "1",
        None,
        "extra bending of the next best order, in units of the typical one; 6 counts as certain",
    ),
    "cpu": ("ms", None, "CPU time per picture of 896 × 672 from the given mask, all threads; median"),
}


@dataclass(frozen=True, eq=False)
class ReferenceOrder:
    """Labels of a picture: places (N, 2) along the cable in order, and crossings (C, 2), px."""

    way_px: np.ndarray
    crossings_px: np.ndarray


@cache
def reference_orders() -> dict[str, ReferenceOrder]:
    """Return the labels by the picture's name."""
    orders = json.loads(ORDERS.read_text())
    return {
        name: ReferenceOrder(np.array(order["way_px"], float), np.array(order["crossings_px"], float))
        for name, order in orders.items()
    }


def read_mask(folder: Path, name: str) -> np.ndarray:
    """Return a picture's mask (896, 672) bool."""
    return np.asarray(read_image(folder / f"{name}_gt.png", cv2.IMREAD_GRAYSCALE) > 127)


def order_faults(string: StillString, expected: ReferenceOrder) -> list[str]:
    """Return the differences from the labelled order; empty where the order is correct."""
    faults = []
    apart = np.linalg.norm(expected.way_px[:, None] - string.line_px[None], axis=2)
    for place, distance in zip(expected.way_px, apart.min(axis=1), strict=True):
        if distance > NEAR_PX:
            faults.append(f"({place[0]:.0f}, {place[1]:.0f}) is {distance:.0f} px from the line")
    along = apart.argmin(axis=1)
    rising = np.diff(along)
    if not ((rising > 0).all() or (rising < 0).all()):
        faults.append(f"the places are passed at {along.tolist()} px")
    found = np.array([crossing.place_px for crossing in string.crossings]).reshape(-1, 2)
    if len(found) != len(expected.crossings_px):
        faults.append(f"{len(found)} crossings instead of {len(expected.crossings_px)}")
    elif (
        np.linalg.norm(expected.crossings_px[:, None] - found[None], axis=2).min(axis=1) > CROSSING_NEAR_PX
    ).any():
        faults.append("a crossing is in another place")
    return faults


def from_axis_px(string: StillString, mask: np.ndarray) -> np.ndarray:
    """Return distances (K,) of the measured points from the nearest pixel of the mask's medial axis, px."""
    off_axis = (~skeletonize(mask)).astype(np.uint8)
    distance = cv2.distanceTransform(off_axis, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    line = string.line_px[string.measured].astype(np.float32)
    return np.asarray(cv2.remap(distance, line[:, 0], line[:, 1], cv2.INTER_LINEAR)).ravel()


def outside_percent(string: StillString, mask: np.ndarray) -> float:
    """Return the share of the centreline's points that are not on the mask [%]."""
    column, row = np.rint(string.line_px).astype(int).T
    inside = (row >= 0) & (column >= 0) & (row < mask.shape[0]) & (column < mask.shape[1])
    inside[inside] = mask[row[inside], column[inside]]
    return float(100.0 * (1.0 - inside.mean()))


def measure(folder: Path) -> list[Figure]:
    """Return the figures over all pictures, from the given masks and from the pictures alone."""
    cpu_ms, outside, off_axis, margins = {}, {}, [], {}
    wrong: dict[str, dict[str, list[str]]] = {"mask": {}, "picture": {}}
    from_mask: dict[str, StillString] = {}
    first = next(iter(reference_orders()))
    string_in_mask(read_mask(folder, first))  # compiles
    for name, expected in reference_orders().items():
        mask = read_mask(folder, name)
        begun = time.process_time()
        string = string_in_mask(mask)
        cpu_ms[name] = 1e3 * (time.process_time() - begun)
        from_mask[name] = string
        outside[name] = outside_percent(string, mask)
        off_axis.append(from_axis_px(string, mask))
        margins[name] = [crossing.margin for crossing in string.crossings]
        wrong["mask"][name] = order_faults(string, expected)
    apart = []
    for name, expected in reference_orders().items():
        try:
            string = string_in_picture(read_image(folder / f"{name}.jpg"))
        except StrandcastError as problem:
            wrong["picture"][name] = [problem.what]
            continue
        wrong["picture"][name] = order_faults(string, expected)
        gaps = np.linalg.norm(string.line_px[:, None] - from_mask[name].line_px[None], axis=2)
        apart.append(gaps.min(axis=1))
    axis, gap = np.concatenate(off_axis), np.concatenate(apart)
    values: dict[str, tuple[float, dict[str, Any] | None]] = {
        "orders_wrong": _wrong(wrong["mask"]),
        "orders_wrong_from_picture": _wrong(wrong["picture"]),
        "outside_mask": (max(outside.values()), {"percent": outside}),
        "from_medial_axis": (
            float(np.median(axis)),
            {"p95_px": float(np.percentile(axis, 95)), "most_px": float(axis.max())},
        ),
        "picture_against_mask": (float(np.median(gap)), {"p95_px": float(np.percentile(gap, 95))}),
        "least_margin": (min(m for each in margins.values() for m in each), {"margins": margins}),
        "cpu": (float(np.median(list(cpu_ms.values()))), {"most_ms": max(cpu_ms.values())}),
    }
    return [
        Figure(f"mbest_s1.{name}", value, *FIGURES[name], detail) for name, (value, detail) in values.items()
    ]


def _wrong(faults: dict[str, list[str]]) -> tuple[float, dict[str, Any] | None]:
    """Return the number of pictures that were ordered wrongly, and their faults."""
    bad = {picture: found for picture, found in faults.items() if found}
    return float(len(bad)), {"faults": bad} if bad else None
