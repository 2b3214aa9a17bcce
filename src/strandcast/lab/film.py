"""Film a throw: paint the moving parts at several instants of each exposure, then add the sensor's noise."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from strandcast.lab.led import LedTimes
from strandcast.lab.paint import expose, gather
from strandcast.lab.rig import PIPE_DIAMETER_M, weight_radius_m
from strandcast.lab.scene import Canvas, LabScene, canvas_on, paint_arm
from strandcast.lab.strings import PhysicalString
from strandcast.lab.swing import LabSwing

# Chosen.
CORD, PIPE, CLAY = 208, 228, 176  # grey levels
MAX_STEP_PX = 0.7  # between the instants of one exposure
MAX_INSTANTS = 24
NOISE_REFERENCE = 128.0
READ_SHARE = 0.35  # of the noise power at the reference level; the rest is photon noise
NOISE_SPARE_PX = 61
FLICKER_SHARE = 0.003
FLICKER_HZ = 100.0


@dataclass(frozen=True)
class Tones:
    """Grey levels of the bare string, its pipes and its weights in full light."""

    cord: float
    pipe: float
    clay: float


TONES = Tones(CORD, PIPE, CLAY)


@dataclass(frozen=True, eq=False)
class FilmSubject:
    """A throw to be filmed: the motion, and the string's thickness, pipes, weights and tones."""

    swing: LabSwing
    diameters_m: np.ndarray
    pipe: np.ndarray
    weights: tuple[tuple[int, float], ...]
    tones: Tones = TONES


def film_subject(swing: LabSwing, string: PhysicalString, tones: Tones = TONES) -> FilmSubject:
    """Return the film's subject, from a throw and the string as held by the clamp."""
    middles = 0.5 * (swing.places_m[1:] + swing.places_m[:-1])
    pipe = np.zeros(len(middles), bool)
    for start, end, _ in string.pipes:
        pipe |= (middles > start) & (middles < end)
    return FilmSubject(
        swing=swing,
        diameters_m=np.full(len(middles), string.diameter_m),
        pipe=pipe,
        weights=tuple(
            (int(np.argmin(np.abs(swing.places_m - place))), weight_radius_m(mass))
            for place, mass in string.weights
        ),
        tones=tones,
    )


def interpolated(swing: LabSwing, time_s: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return joint angles (..., J) and nodes (..., N, 2) at times since the motion's start."""
    place = np.interp(time_s, swing.time_s, np.arange(len(swing.time_s)))
    k = np.minimum(np.floor(place).astype(int), len(swing.time_s) - 2)
    part = np.asarray(place - k)
    q = swing.q_rad[k] + part[..., None] * (swing.q_rad[k + 1] - swing.q_rad[k])
    nodes = swing.nodes_m[k] + part[..., None, None] * (swing.nodes_m[k + 1] - swing.nodes_m[k])
    return q, nodes


def film_frames(
    scene: LabScene,
    actors: FilmSubject,
    middles_s: np.ndarray,
    exposure_s: float,
    noise_grey: float,
    random: np.random.Generator,
    switched: LedTimes | None = None,
) -> Iterator[np.ndarray]:
    """Yield the frames (H, W) uint8 of a throw; each overwrites the one before.

    Parameters
    ----------
    middles_s
        (F,) middle of each exposure since the motion's start [s].
    noise_grey
        Standard deviation of the sensor's noise at grey level 128.
    switched
        When the scene's LED is lit.
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
        for q, nodes in zip(*interpolated(actors.swing, times), strict=True):
            paint_instant(canvas, scene, actors, q, nodes)
            gather(light, canvas.light, still, canvas.touched, 1.0 / len(times))
        corner = (int(random.integers(NOISE_SPARE_PX)), int(random.integers(NOISE_SPARE_PX)))
        flicker = 1.0 + FLICKER_SHARE * np.sin(2.0 * np.pi * FLICKER_HZ * middle_s)
        expose(light, scene.gain, flicker, bank, corner, powers, out)
        yield out


def light_led(scene: LabScene, still: np.ndarray, canvas: Canvas, share: float) -> None:
    """Light the LED on `still` (H, W) and on the canvas, in place, for a share of the exposure."""
    if scene.led is not None:
        part = scene.led.rows, scene.led.columns
        still[part] = scene.still[part] + np.float32(share) * scene.led.glow
        canvas.light[part] = still[part]


def noise_powers(noise_grey: float) -> tuple[float, float]:
    """Return a sensor's read-out noise power [grey²] and photon noise power [grey² per grey]."""
    power = noise_grey**2
    return power * READ_SHARE, power * (1.0 - READ_SHARE) / NOISE_REFERENCE


def _instants(scene: LabScene, swing: LabSwing, middle_s: float, exposure_s: float) -> np.ndarray:
    """Return instants of an exposure, so close that nothing moves by more than MAX_STEP_PX."""
    ends = np.array([-0.5, 0.5]) * exposure_s + middle_s
    first, last = interpolated(swing, ends)[1]
    moved_px = np.abs(scene.view.pixels(last) - scene.view.pixels(first)).max()
    count = int(np.clip(np.ceil(moved_px / MAX_STEP_PX), 1, MAX_INSTANTS))
    return middle_s + exposure_s * ((np.arange(count) + 0.5) / count - 0.5)


def paint_instant(
    canvas: Canvas, scene: LabScene, actors: FilmSubject, q: np.ndarray, nodes: np.ndarray
) -> None:
    """Paint string, arm and hand markers, from back to front, and what hides them."""
    view = scene.view
    line = view.pixels(nodes)
    scale = view.scale_px_m(nodes[len(nodes) // 2])
    canvas.stroke(line, 0.5 * actors.diameters_m * scale, actors.tones.cord)
    for k in np.flatnonzero(actors.pipe):
        canvas.stroke(line[k : k + 2], np.array([0.5 * PIPE_DIAMETER_M * scale]), actors.tones.pipe)
    for node, radius in actors.weights:
        canvas.dot(line[node], radius * scale, actors.tones.clay)
    paint_arm(canvas, scene, q)
    if scene.in_front is not None:
        canvas.light[scene.in_front] = scene.still[scene.in_front]
