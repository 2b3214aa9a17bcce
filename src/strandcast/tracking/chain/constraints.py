"""Constraints on a chain's fit: detections, the tip, beads, the clamp, the prediction, the stiffness."""

from typing import NamedTuple

import numpy as np


class Tip(NamedTuple):
    """How far the tip should move along the last link."""

    along_m: float
    weight: float  # 1/variance (1/m²); 0 if unknown


class Pins(NamedTuple):
    """Places on the chain that are known in both directions, e.g. of beads."""

    place_m: np.ndarray  # along the chain, (P,)
    point_m: np.ndarray  # (P, 2)
    weight: np.ndarray  # 1/variance per axis (1/m²), (P,)


class Anchors(NamedTuple):
    """The tip and the pins, which hold the chain along the string."""

    tip: Tip
    pins: Pins


class Stiffness(NamedTuple):
    """How a string bends: standard deviations (rad; `root_m` in m)."""

    change: float  # of a bend relative to the joint before
    bend: float  # of a bend
    hidden: float  # of a bend where nothing is detected: between visible ends a taut string is straight
    prior: float  # of a heading relative to the prediction
    clamp: float  # of the first heading relative to the clamp's
    root_m: float  # of the chain's start relative to the clamp: the hand hides an unknown length of string


class Constraints(NamedTuple):
    """Detections, predictions and stiffness of a chain of M links."""

    target: np.ndarray  # detected place of each node (m), (M + 1, 2)
    normals: np.ndarray  # direction in which each detection is valid, (M + 1, 2)
    weight: np.ndarray  # 1/variance of each detection (1/m²), (M + 1,); 0 where nothing was detected
    anchors: Anchors
    prior: np.ndarray  # predicted headings (rad), (M,)
    clamp_m: np.ndarray  # where the string leaves the clamp, (2,)
    clamp_rad: float  # and in which direction
    stiffness: Stiffness


NO_TIP = Tip(0.0, 0.0)
