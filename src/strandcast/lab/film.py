"""Film a throw: what moves is painted instant by instant over an exposure, then seen by a noisy sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from strandcast.lab.led import Switched
from strandcast.lab.paint import expose, gather
from strandcast.lab.rig import PIPE_DIAMETER_M, weight_radius_m
from strandcast.lab.scene import Canvas, Scene, canvas_on, paint_arm
from strandcast.lab.strings import Thread
from strandcast.lab.swing import Swing

CORD, PIPE, CLAY = 208, 228, 176
LONGEST_STEP_PX = 0.7  # between the instants of one exposure
MOST_INSTANTS = 24
NOISE_REFERENCE = 128.0
READ_SHARE = 0.35  # of the noise's power at the reference level; the rest is photons'
NOISE_SPARE_PX = 61
FLICKER_SHARE = 0.003
FLICKER_HZ = 100.0


@dataclass(frozen=True)
class Tones:
    """Grey levels, in full light, of the bare string, its pipes and its weights."""

    cord: float
    pipe: float
    clay: float


TONES = Tones(CORD, PIPE, CLAY)


@dataclass(frozen=True, eq=False)
class Actors:
    """What moves before the camera, where on the string's nodes what hangs, and how it looks."""

    swing: Swing
    diameters_m: np.ndarray
    pipe: np.ndarray
    weights: tuple[tuple[int, float], ...]
    tones: Tones = TONES


def actors_of(swing: Swing, thread: Thread, tones: Tones = TONES) -> Actors:
    """Return what is to be painted of a throw with the string as it hung out of the clamp."""
    middles = 0.5 * (swing.places_m[1:] + swing.places_m[:-1])
    pipe = np.zeros(len(middles), bool)
    for start, end, _ in thread.pipes:
        pipe |= (middles > start) & (middles < end)
    return Actors(
        swing=swing,
        diameters_m=np.full(len(middles), thread.diameter_m),
        pipe=pipe,
        weights=tuple(
            (int(np.argmin(np.abs(swing.places_m - place))), weight_radius_m(mass))
            for place, mass in thread.weights
        ),
        tones=tones,
    )


def at(swing: Swing, time_s: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return joint angles (..., J) and nodes (..., N, 2) at times from the motion's start."""
    place = np.interp(time_s, swing.time_s, np.arange(len(swing.time_s)))
    k = np.minimum(np.floor(place).astype(int), len(swing.time_s) - 2)
    part = np.asarray(place - k)
    q = swing.q_rad[k] + part[..., None] * (swing.q_rad[k + 1] - swing.q_rad[k])
    nodes = swing.nodes_m[k] + part[..., None, None] * (swing.nodes_m[k + 1] - swing.nodes_m[k])
    return q, nodes


def frames(
    scene: Scene,
    actors: Actors,
    middles_s: np.ndarray,
    exposure_s: float,
    noise_grey: float,
    random: np.random.Generator,
    switched: Switched | None = None,
) -> Iterator[np.ndarray]:
    """Yield the frames (H, W) uint8 of a throw; each is overwritten by the next.

    Parameters
    ----------
    middles_s
        (F,) middle of each exposure, from the motion's start [s].
    exposure_s
        Length of the exposures [s].
    noise_grey
        Standard deviation of the sensor's noise at a middle grey.
    random
        For the noise.
    switched
        When the scene's LED is lit, from the motion's start.
    """
    canvas = canvas_on(scene.still)
    still = scene.still if scene.led is None else scene.still.copy()
    height, width = scene.still.shape
    bank = random.standard_normal((height + NOISE_SPARE_PX, width + NOISE_SPARE_PX), dtype=np.float32)
    powers = noise_powers(noise_grey)
    out = np.empty((height, width), np.uint8)
    light = scene.still.copy()
    for middle_s in middles_s:
        if switched is not None:
            light_led(scene, still, canvas, switched.share(middle_s, exposure_s))
        light[:] = still
        times = _instants(scene, actors.swing, middle_s, exposure_s)
        for q, nodes in zip(*at(actors.swing, times), strict=True):
            paint_instant(canvas, scene, actors, q, nodes)
            gather(light, canvas.light, still, canvas.touched, 1.0 / len(times))
        corner = (int(random.integers(NOISE_SPARE_PX)), int(random.integers(NOISE_SPARE_PX)))
        flicker = 1.0 + FLICKER_SHARE * np.sin(2.0 * np.pi * FLICKER_HZ * middle_s)
        expose(light, scene.gain, flicker, bank, corner, powers, out)
        yield out


def light_led(scene: Scene, still: np.ndarray, canvas: Canvas, share: float) -> None:
    """Set the LED's light on `still` (H, W) and on the canvas to that of a share of an exposure, in place."""
    if scene.led is not None:
        part = scene.led.rows, scene.led.columns
        still[part] = scene.still[part] + np.float32(share) * scene.led.glow
        canvas.light[part] = still[part]


def noise_powers(noise_grey: float) -> tuple[float, float]:
    """Return the powers of read-out noise [grey²] and of photon noise [grey² per grey] of a sensor."""
    power = noise_grey**2
    return power * READ_SHARE, power * (1.0 - READ_SHARE) / NOISE_REFERENCE


def _instants(scene: Scene, swing: Swing, middle_s: float, exposure_s: float) -> np.ndarray:
    """Return instants of an exposure, close enough that nothing jumps by more than LONGEST_STEP_PX."""
    ends = np.array([-0.5, 0.5]) * exposure_s + middle_s
    first, last = at(swing, ends)[1]
    way = np.abs(scene.view.pixels(last) - scene.view.pixels(first)).max()
    count = int(np.clip(np.ceil(way / LONGEST_STEP_PX), 1, MOST_INSTANTS))
    return middle_s + exposure_s * ((np.arange(count) + 0.5) / count - 0.5)


def paint_instant(canvas: Canvas, scene: Scene, actors: Actors, q: np.ndarray, nodes: np.ndarray) -> None:
    """Paint string, arm and hand markers, from the back to the front."""
    view = scene.view
    line = view.pixels(nodes)
    scale = view.scale_px_m(nodes[len(nodes) // 2])
    canvas.stroke(line, 0.5 * actors.diameters_m * scale, actors.tones.cord)
    for k in np.flatnonzero(actors.pipe):
        canvas.stroke(line[k : k + 2], np.array([0.5 * PIPE_DIAMETER_M * scale]), actors.tones.pipe)
    for node, radius in actors.weights:
        canvas.stroke(line[[node, node]], np.array([radius * scale]), actors.tones.clay)
    paint_arm(canvas, scene, q)
