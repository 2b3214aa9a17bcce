"""How far a string left the plane of motion, from how long it looks to the one camera.

A string that tilts out of the plane looks shorter, and longer where that brings it nearer to the camera. One
camera cannot see which, and a tilt with which both cancel stays hidden: what is found is the least.
"""

from typing import NamedTuple

import numpy as np

from strandcast.records.camera import Camera
from strandcast.tracking.chain.bidirectional import clear_paths
from strandcast.tracking.chain.fit import CLEAR, FrameFit
from strandcast.tracking.chain.frames import StringFrames

# Frames whose apparent length is accurate, chosen on eleven lab throws in the plane: it varied by at most
# 1.0 mm between its deciles, on strings of 0.3 and 0.5 m.
HIDDEN_M = 0.09  # of string at the clamp
FOLD_RAD = 0.4  # bend from a link to the next but one: a tighter one is cut short
CLEAR_SHARE = 0.8  # of the nodes beyond the hidden ones
LEAST_FRAMES = 20
DECILES = (10.0, 90.0)
# Chosen: share of the length's range that one step leaves, if it is a slip. Two slips in lab throws left a
# tenth, a string that sways to and fro half of it or more.
SLIP_SHARE = 0.3
TILTS_RAD = np.linspace(-0.8, 0.8, 161)


class ApparentStrings(NamedTuple):
    """The string in frames that show its length well."""

    nodes_m: np.ndarray  # of the chain, (K, M + 1, 2)
    path_m: np.ndarray  # apparent length, from the clamp to the tip, (K,)
    direction_rad: np.ndarray  # in which it leaves, in the hand's frame, (K,)


class OutOfPlane(NamedTuple):
    """Motion out of the plane."""

    length_range_m: float  # of the apparent length, between its deciles
    depth_m: float  # of the tip off the plane: at least this much in a tenth of the frames
    tip_error_m: float  # by which one camera misplaces the tip in the plane then


def apparent_strings(frames: StringFrames, fits: list[FrameFit | None]) -> ApparentStrings:
    """Return the frames that show the string's length without folds and gaps."""
    nodes, paths, directions = [], [], []
    for fit, first, path_m, direction_rad in clear_paths(frames, fits):
        fold = np.abs(fit.heading[2:] - fit.heading[:-2]).max(initial=0.0)
        shown = (fit.reward[first:] >= CLEAR).mean()
        if first * fit.link_m <= HIDDEN_M and fold <= FOLD_RAD and shown >= CLEAR_SHARE:
            nodes.append(fit.nodes())
            paths.append(path_m)
            directions.append(direction_rad)
    return ApparentStrings(np.array(nodes), np.array(paths), np.array(directions))


def measure_out_of_plane(
    strings: ApparentStrings, length_m: float, camera: Camera, least_m: float = 0.0
) -> OutOfPlane | None:
    """Return how far the string was out of the plane at least, as a string that tilts as a whole.

    Parameters
    ----------
    strings
        As they look.
    length_m
        The free length that the frames show together.
    camera
        The record of the camera.
    least_m
        Range of the apparent length from which it is measured.

    Returns
    -------
    OutOfPlane or None
        None for fewer than 20 frames, for a smaller range, or for a length that changes once and stays: the
        string has slipped in its clamp.
    """
    if len(strings.path_m) < LEAST_FRAMES:
        return None
    change_m = strings.path_m - length_m
    if between_deciles(without_step(change_m)) < SLIP_SHARE * between_deciles(change_m):
        return None
    # A clamp that is not where the arm's file says changes the path with the string's direction at the hand.
    turned = np.column_stack([np.cos(strings.direction_rad), np.sin(strings.direction_rad)])
    turned -= turned.mean(axis=0)
    in_place_m = change_m - turned @ np.linalg.lstsq(turned, change_m, rcond=None)[0]
    change_m = min(change_m, in_place_m, key=between_deciles)  # a fold in a few frames turns the fit
    range_m = between_deciles(change_m)
    if range_m < least_m:
        return None
    eye_m = -np.array(camera.rotation).T @ np.array(camera.translation_m)
    height_m = eye_m[2] - camera.string_offset_m
    tilt_rad = least_tilt_rad(strings.nodes_m, change_m, length_m, eye_m[:2], height_m)
    depth_m = length_m * np.sin(np.abs(tilt_rad))
    off_axis_m = np.linalg.norm(strings.nodes_m[:, -1] - eye_m[:2], axis=1)
    error_m = off_axis_m * depth_m / height_m
    return OutOfPlane(
        range_m,
        float(np.percentile(depth_m, DECILES[1])),
        float(np.percentile(error_m, DECILES[1])),
    )


def between_deciles(values: np.ndarray) -> float:
    """Return the range of values (K,) without the lowest and the highest tenth."""
    low, high = np.percentile(values, DECILES)
    return float(high - low)


def without_step(change_m: np.ndarray) -> np.ndarray:
    """Return changes (K,) without the one step that explains them best."""
    count = np.arange(1, len(change_m))
    total = np.cumsum(change_m)
    before, after = total[:-1] / count, (total[-1] - total[:-1]) / (len(change_m) - count)
    at = int(np.argmax(count * before**2 + (len(change_m) - count) * after**2))
    return np.asarray(change_m - np.where(np.arange(len(change_m)) <= at, before[at], after[at]))


def least_tilt_rad(
    nodes_m: np.ndarray, change_m: np.ndarray, length_m: float, foot_m: np.ndarray, height_m: float
) -> np.ndarray:
    """Return the smallest tilts (K,) about the hand with which strings of known length look as they do.

    Parameters
    ----------
    nodes_m
        (K, M+1, 2) where the strings look to be in the plane.
    change_m
        (K,) apparent length minus `length_m`.
    foot_m, height_m
        (2,) foot of the camera's centre on the plane, and its height above.
    """
    hand_m = nodes_m[:, :1]
    size_m = np.linalg.norm(np.diff(nodes_m, axis=1), axis=2).sum(axis=1)
    looks_m = hand_m + (nodes_m - hand_m) * ((length_m + change_m) / size_m)[:, None, None]
    along_m = np.linspace(0.0, length_m, nodes_m.shape[1])
    excess_m = np.empty((len(nodes_m), len(TILTS_RAD)))
    for k, tilt_rad in enumerate(TILTS_RAD):
        depth_m = along_m * np.sin(tilt_rad)
        places_m = looks_m + (foot_m - looks_m) * (depth_m / height_m)[:, None]
        steps_m = np.linalg.norm(np.diff(places_m, axis=1), axis=2)
        excess_m[:, k] = np.hypot(steps_m, np.diff(depth_m)).sum(axis=1) - length_m
    before, after = excess_m[:, :-1], excess_m[:, 1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = TILTS_RAD[:-1] - before / (after - before) * np.diff(TILTS_RAD)
    crossing = np.where(before * after <= 0.0, crossing, np.inf)
    nearest = crossing[np.arange(len(crossing)), np.argmin(np.abs(crossing), axis=1)]
    closest = TILTS_RAD[np.argmin(np.abs(excess_m), axis=1)]  # where no tilt gives the length
    return np.asarray(np.where(np.isfinite(nearest), nearest, closest))
