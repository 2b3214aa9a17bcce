"""Ray casting by random sampling: each sample of a pixel has its own place, place in the lens and instant.

Light is linear, from 0 to 1. Everything lies in planes parallel to that of the throw, so that a sample meets
each of them in one place [m], where shapes are tested as they are: no strokes, no filters.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

SAMPLES = 48  # of a pixel; chosen: the noise they leave is below the sensor's
INSTANTS = 12  # of an exposure
FEW = 4  # every fourth sample is enough away from the string
REACH_M = 0.012  # of what moves, within one exposure

ROUND, CUT, FRAYED = 0, 1, 2  # the string's end: a half circle beyond its last node, or cut off there
BALL, NUT = 0, 1


class Thread(NamedTuple):
    """The string's look."""

    radius_m: float
    tone: float
    shade: float  # share of the light that is lost at its edges
    end: int
    fibres: np.ndarray  # (K, 3) of a frayed end: angle [rad], length [m], radius [m]
    weights: np.ndarray  # (W, 4): node, radius [m], tone, BALL or NUT
    sleeve: np.ndarray  # (4,): from node, to node, radius [m], tone; none if the nodes are equal


class Body(NamedTuple):
    """The arm and the plate on its hand."""

    radii_m: np.ndarray  # (J,) of the links
    tone: float
    plate: np.ndarray  # (4,): left, right, low and high edge in the hand's frame [m]
    plate_tone: float
    prints: np.ndarray  # (M, 3): left and low edge of each marker in the hand's frame, side [m]
    cells: np.ndarray  # (M, C, C) tones, rows from the top


@njit(cache=True, nogil=True)
def mark(near: np.ndarray, line_px: np.ndarray, reach_px: float) -> None:
    """Widen each pixel's range of links (H, W, 2) by those of polylines (T, N, 2) that come near it."""
    height, width = near.shape[:2]
    for t in range(len(line_px)):
        for k in range(line_px.shape[1] - 1):
            a, b = line_px[t, k], line_px[t, k + 1]
            left, right = min(a[0], b[0]) - reach_px, max(a[0], b[0]) + reach_px
            low, high = min(a[1], b[1]) - reach_px, max(a[1], b[1]) + reach_px
            for v in range(max(0, int(low)), min(height, int(high) + 2)):
                for u in range(max(0, int(left)), min(width, int(right) + 2)):
                    near[v, u, 0] = min(near[v, u, 0], k)
                    near[v, u, 1] = max(near[v, u, 1], k + 1)


@njit(cache=True, nogil=True)
def along_link(x: float, y: float, a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Return how far along a link, as a share, and how far beside it a place is."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = max(dx * dx + dy * dy, 1e-18)
    share = ((x - a[0]) * dx + (y - a[1]) * dy) / square
    held = min(1.0, max(0.0, share))
    return share, math.hypot(x - a[0] - held * dx, y - a[1] - held * dy)


@njit(cache=True, nogil=True)
def string_tone(x: float, y: float, nodes: np.ndarray, first: int, last: int, thread: Thread) -> float:
    """Return the tone of the string and what hangs on it at a place; negative where there is neither."""
    for w in range(len(thread.weights)):
        node, radius, tone, kind = thread.weights[w]
        centre = nodes[int(node)]
        off = math.hypot(x - centre[0], y - centre[1])
        if off < radius:
            if kind == BALL:
                return float(tone * (0.55 + 0.45 * math.sqrt(1.0 - (off / radius) ** 2)))
            turn = math.atan2(y - centre[1], x - centre[0]) % (math.pi / 3.0) - math.pi / 6.0
            if off * math.cos(turn) < 0.866 * radius:
                return float(tone * (1.3 if x + y > centre[0] + centre[1] + 0.3 * radius else 0.8))
    links = len(nodes) - 1
    for k in range(first, last):
        share, off = along_link(x, y, nodes[k], nodes[k + 1])
        in_sleeve = thread.sleeve[0] <= k < thread.sleeve[1]
        radius = thread.sleeve[2] if in_sleeve else thread.radius_m
        if off >= radius or (k == links - 1 and share > 1.0 and thread.end != ROUND):
            continue
        tone = thread.sleeve[3] if in_sleeve else thread.tone
        return tone * (1.0 - thread.shade * (1.0 - math.sqrt(1.0 - (off / radius) ** 2)))
    if thread.end == FRAYED and last == links:
        end, before = nodes[links], nodes[links - 1]
        heading = math.atan2(end[1] - before[1], end[0] - before[0])
        tip = np.empty(2)
        for f in range(len(thread.fibres)):
            angle, length, radius = thread.fibres[f]
            tip[0] = end[0] + length * math.cos(heading + angle)
            tip[1] = end[1] + length * math.sin(heading + angle)
            if along_link(x, y, end, tip)[1] < radius:
                return thread.tone
    return -1.0


@njit(cache=True, nogil=True)
def body_tone(
    x: float, y: float, plate_x: float, plate_y: float, hand: np.ndarray, joints: np.ndarray, body: Body
) -> float:
    """Return the tone of the plate or the arm at a place; negative where there is neither."""
    cos, sin = math.cos(hand[2]), math.sin(hand[2])
    px = (plate_x - hand[0]) * cos + (plate_y - hand[1]) * sin
    py = -(plate_x - hand[0]) * sin + (plate_y - hand[1]) * cos
    if body.plate[0] <= px <= body.plate[1] and body.plate[2] <= py <= body.plate[3]:
        for m in range(len(body.prints)):
            left, low, side = body.prints[m]
            count = body.cells.shape[1]
            column, row = (
                math.floor((px - left) / side * count),
                math.floor((1.0 - (py - low) / side) * count),
            )
            if 0 <= column < count and 0 <= row < count:
                return float(body.cells[m, row, column])
        return body.plate_tone
    for j in range(len(joints) - 1):
        if along_link(x, y, joints[j], joints[j + 1])[1] < body.radii_m[j]:
            return body.tone
    return -1.0


@njit(cache=True, nogil=True)
def near_body(x: float, y: float, joints: np.ndarray, body: Body) -> bool:
    """Return whether the arm, or the plate along its last link, may cover a pixel with its middle there."""
    near = False
    for j in range(len(joints) - 1):
        half = body.radii_m[j] if j < len(joints) - 2 else body.plate[3]
        near |= along_link(x, y, joints[j], joints[j + 1])[1] < half + REACH_M
    return near


@njit(cache=True, nogil=True)
def cast(
    light: np.ndarray,
    still: np.ndarray,
    places: np.ndarray,
    plate_places: np.ndarray,
    slopes: np.ndarray,
    offsets: np.ndarray,
    near: np.ndarray,
    around_body: np.ndarray,
    nodes: np.ndarray,
    hands: np.ndarray,
    joints: np.ndarray,
    thread: Thread,
    body: Body,
) -> None:
    """Render one exposure onto `light` (H, W), from the still scene's light (H, W).

    Parameters
    ----------
    places, plate_places
        (H, W, 2) where each pixel's middle meets the plane of the throw, and that of the plate [m].
    slopes
        (H, W, 2, 2) how far that moves along x and y, per pixel to the right and down.
    offsets
        (S, 2) of the samples from the pixel's middle [px]; sample s has instant s % T.
    near
        (H, W, 2) range of the string's links that may be seen there.
    around_body
        (4,) left, right, top and bottom pixel of what body and plate may cover.
    nodes, hands, joints
        (T, N, 2), (T, 3) and (T, J + 1, 2) at the instants.
    """
    height, width = still.shape
    left, right, top, bottom = around_body
    for v in range(height):
        for u in range(width):
            light[v, u] = still[v, u]
            with_string = near[v, u, 1] > near[v, u, 0]
            with_body = left <= u < right and top <= v < bottom
            with_body = with_body and near_body(places[v, u, 0], places[v, u, 1], joints[0], body)
            if not (with_string or with_body):
                continue
            total, count = 0.0, 0
            for s in range(0, len(offsets), 1 if with_string else FEW):
                t = s % len(nodes)
                du, dv = offsets[s]
                dx = slopes[v, u, 0, 0] * du + slopes[v, u, 0, 1] * dv
                dy = slopes[v, u, 1, 0] * du + slopes[v, u, 1, 1] * dv
                x, y = places[v, u, 0] + dx, places[v, u, 1] + dy
                tone = -1.0
                if with_string:
                    tone = string_tone(x, y, nodes[t], near[v, u, 0], near[v, u, 1], thread)
                if tone < 0.0 and with_body:
                    px, py = plate_places[v, u, 0] + dx, plate_places[v, u, 1] + dy
                    tone = body_tone(x, y, px, py, hands[t], joints[t], body)
                total += still[v, u] if tone < 0.0 else tone
                count += 1
            light[v, u] = total / count


@njit(cache=True, nogil=True, fastmath=True)
def expose(
    light: np.ndarray, noise: np.ndarray, power: float, gamma: float, out: np.ndarray, full: float
) -> None:
    """Turn light (H, W) into a sensor's numbers; `power` is that of its noise at half of full light."""
    for v in range(light.shape[0]):
        for u in range(light.shape[1]):
            seen = light[v, u]
            seen += math.sqrt(power * (0.3 + 1.4 * max(seen, 0.0))) * noise[v, u]
            seen = min(1.0, max(0.0, seen))
            out[v, u] = int(full * (seen if gamma == 1.0 else seen ** (1.0 / gamma)) + 0.5)
