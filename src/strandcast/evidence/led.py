"""What is a sync LED worth? Filmed throws of the lab with known clocks, aligned with it and without.

``python -m strandcast.evidence.led [--throws N]`` prints a table to standard error and JSON to standard
output; docs/alignment.md holds the figures. The camera is the lab's own, so that nothing but pictures of
markers and of the LED is between the clocks.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.alignment.align import align
from strandcast.alignment.events import SeenEvent, clock_of_events
from strandcast.alignment.led import Led, led_events, pair_led
from strandcast.arm.load import Arm, load_arm
from strandcast.errors import StrandcastError
from strandcast.evidence.clock_trials import ARM_FILE
from strandcast.experiment import Experiment
from strandcast.lab.driver import VIDEO, LabDriver, Throw
from strandcast.lab.led import LATENCY_S
from strandcast.lab.led import switched as lab_switched
from strandcast.player.protocol import Command, Recording
from strandcast.records.alignment import Alignment
from strandcast.records.camera import Camera, Lens
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.tables import read_facts
from strandcast.records.track import SeenLed
from strandcast.seeds import rng
from strandcast.tracking.crops import Crops
from strandcast.tracking.hand import HandFinder, HandMarker
from strandcast.tracking.led import LedPlace, LedWatch
from strandcast.tracking.pixelmap import tabulate
from strandcast.tracking.track import Options, decode, marker_columns
from strandcast.video.ingest import camera_times, inspect_video

NORMAL = 1.96
THROWS = 3
FREE_M, IN_THE_WAY_M = (0.60, 0.76), (0.62, 0.05)  # of the LED: beside the string's way, and behind it
MARKERS_M = ((-0.25, 0.75), (0.3, 0.76), (0.85, 0.75), (-0.25, -0.4), (0.3, -0.42), (0.85, -0.4))
TARGET_M = (0.55, 0.35)
KNOWN_S, KNOWN_SD_S = 0.5 * sum(LATENCY_S), (LATENCY_S[1] - LATENCY_S[0]) / 12**0.5
UNKNOWN_SD_S = 5e-4
DRIFT_PRIOR = 5e-5
FALSE_S = 0.03  # from a true switching, beyond which a seen one is none


@dataclass(frozen=True)
class Kind:
    """A camera, and where the LED is."""

    rate_hz: float
    exposure_s: float
    noise_grey: float = 2.5
    place_m: tuple[float, float] = FREE_M


KINDS = (
    Kind(120.0, 4e-4),
    Kind(120.0, 6e-3),
    Kind(240.0, 4e-4, 6.0),
    Kind(240.0, 3e-3),
    Kind(500.0, 4e-4),
    Kind(500.0, 1.6e-3, 6.0),
    Kind(240.0, 1e-3, place_m=IN_THE_WAY_M),
)


@dataclass(frozen=True)
class Offsets:
    """How one way to the offset went over all throws: error in the middle [ms], over its standard error."""

    throws: int
    mean_ms: float
    rms_ms: float
    p95_ms: float
    z_rms: float
    within: float


def experiment_of(kind: Kind) -> Experiment:
    """Return the virtual rig of a kind of throw."""
    markers = [{"id": k, "x_m": x, "y_m": y} for k, (x, y) in enumerate(MARKERS_M)]
    camera = {
        "width_px": 640,
        "height_px": 512,
        "frame_rate_hz": kind.rate_hz,
        "exposure_s": kind.exposure_s,
        "noise_grey": kind.noise_grey,
    }
    return Experiment.model_validate(
        {
            "string": {"length_m": 0.3},
            "target_m": TARGET_M,
            "workspace_m": {"x_m": (-0.32, 0.92), "y_m": (-0.48, 0.82)},
            "camera": {"plane": {"size_m": 0.08, "markers": markers}},
            "align": {"led": {"x_m": kind.place_m[0], "y_m": kind.place_m[1]}},
            "lab": {"camera": camera, "led": True},
        }
    )


def command_of(arm: Arm, random: np.random.Generator) -> Command:
    """Draw a swing: each joint from rest to rest, by its own angle, in its own time."""
    cycle_s = 1.0 / arm.log_rate_hz
    duration_s = float(random.uniform(0.35, 0.6))
    time_s = np.arange(round(duration_s / cycle_s) + 1) * cycle_s
    late, by = random.uniform(0.0, 0.3, 3), random.uniform(0.4, 0.9, 3)
    s = np.clip((time_s[:, None] / time_s[-1] - late) / (1.0 - late), 0.0, 1.0)
    q = np.array([0.3, -0.6, -0.5]) + by * s**3 * (10 - 15 * s + 6 * s**2)
    qd = np.gradient(q, cycle_s, axis=0)
    return Command(time_s, q, qd, np.gradient(qd, cycle_s, axis=0))


@dataclass(frozen=True, eq=False)
class Filmed:
    """What a throw shows, and what is true of it: robot_time = camera_time · (1 + drift) + offset."""

    markers: dict[str, np.ndarray]
    led: SeenLed
    record: Recording
    offset_s: float
    drift: float
    latency_s: float
    look_s: float  # CPU time of the LED's window, per frame

    def robot_s(self, camera_s: float) -> float:
        """Return the robot's true time at a camera's."""
        return camera_s * (1.0 + self.drift) + self.offset_s


def film(arm: Arm, kind: Kind, seed: int, folder: Path, gamma: float | None = 1.0) -> Filmed:
    """Throw and film, then look at the film as tracking does."""
    settings = experiment_of(kind).model_copy(update={"seed": seed})
    name, truth = f"led-{round(kind.rate_hz)}", folder / "truth.parquet"
    command = command_of(arm, rng(name, seed, 0, "swing"))
    driver = LabDriver(Throw(name, settings, 1, truth), arm)
    driver.move_to_start(command.q_rad[0])
    record = driver.play(command, folder)
    facts = read_facts(truth, LAB_TRUTH)
    camera = camera_of(facts["camera"], settings)
    video = inspect_video(folder / VIDEO)
    hand = [HandMarker(m.id, m.size_m, m.place_m, m.angle_rad, m.offset_m) for m in arm.markers]
    finder = HandFinder(camera, hand, arm.marker_dictionary, 0.0)
    watch = TimedWatch(LedPlace(kind.place_m, gamma=gamma), camera)
    with Crops(tabulate(camera, 0.0), 0.3) as crops:
        scene = decode(folder / VIDEO, video, finder, crops, Options(), watch)
    time_s = camera_times(video)
    motion_s = record.motion_end_s - record.motion_start_s
    lamp = lab_switched(motion_s, rng(name, seed, 1, "lab-led"))
    return Filmed(
        markers=marker_columns(finder, scene.hands, time_s),
        led=watch.found(time_s, kind.exposure_s)[0],
        record=record,
        offset_s=facts["offset_s"],
        drift=facts["drift"],
        latency_s=lamp.latency_s,
        look_s=watch.cpu_s / len(time_s),
    )


class TimedWatch(LedWatch):
    """Counts its own CPU time."""

    cpu_s = 0.0

    def look(self, image: np.ndarray) -> None:
        """Take in a frame."""
        before_s = time.thread_time()
        super().look(image)
        self.cpu_s += time.thread_time() - before_s


def camera_of(truth: dict[str, Any], settings: Experiment) -> Camera:
    """Return the lab's camera as a calibration without errors would give it."""
    assert settings.lab is not None
    size = settings.lab.camera
    lens = Lens(
        width_px=size.width_px,
        height_px=size.height_px,
        matrix=truth["matrix"],
        distortion=truth["distortion"],
        rms_px=0.1,
    )
    return Camera(
        lens=lens,
        rotation=truth["rotation"],
        translation_m=truth["translation_m"],
        plane_rms_px=0.1,
        plane_markers=[],
        string_offset_m=0.0,
        scale_m_per_px=truth["translation_m"][2] / truth["matrix"][0][0],
        source="given",
    )


def switch_errors(throw: Filmed) -> tuple[list[float], list[float], int]:
    """Return errors of the switchings' times [s], their sigmas, and how many have no true one near."""
    errors, sigmas, false = [], [], 0
    for seen in throw.led.events:
        true_s = [e.time_s + throw.latency_s for e in throw.record.sync_events if e.kind == seen.kind]
        off_s = min((throw.robot_s(seen.camera_time_s) - at_s for at_s in true_s), key=abs, default=1.0)
        if abs(off_s) > FALSE_S:
            false += 1
        else:
            errors.append(off_s)
            sigmas.append(seen.sigma_s)
    return errors, sigmas, false


def offsets_of(
    arm: Arm, throw: Filmed, latency_s: float, latency_sd_s: float
) -> dict[str, tuple[float, float]]:
    """Return error and standard error of the offset, in the middle, by LED alone, by fit alone, by both."""
    seen = [SeenEvent(e.kind, e.camera_time_s, e.sigma_s) for e in throw.led.events]
    led = Led(seen, latency_s, latency_sd_s)
    found: dict[str, tuple[float, float]] = {}
    pairs = pair_led(led, led_events(throw.record.log, throw.record.sync_events), None, 0.0, "").events
    if pairs:
        clock, covariance, middle_s = clock_of_events(pairs, 0.0, DRIFT_PRIOR)
        found["LED alone"] = (float(clock[0]) - throw.robot_s(middle_s), float(np.sqrt(covariance[0, 0])))
    for name, with_led in (("fit alone", None), ("both", led)):
        try:
            fit = align(
                throw.markers,
                throw.record.log,
                arm,
                experiment="led",
                trial=1,
                told_events=throw.record.sync_events,
                led=with_led,
            )
        except StrandcastError as refusal:
            print(f"{name}: {refusal.code}", file=sys.stderr)
            continue
        found[name] = _error(fit, throw)
    return found


def _error(fit: Alignment, throw: Filmed) -> tuple[float, float]:
    assert fit.middle_camera_time_s is not None
    assert fit.middle_se_s is not None
    told_s = float(fit.robot_time_s(np.array(fit.middle_camera_time_s)))
    return told_s - throw.robot_s(fit.middle_camera_time_s), fit.middle_se_s


def offsets(rows: list[tuple[float, float]]) -> Offsets:
    """Return how errors and standard errors (T, 2) went."""
    error, sigma = np.array(rows).T
    z = error / sigma
    return Offsets(
        throws=len(rows),
        mean_ms=float(error.mean() * 1e3),
        rms_ms=float(np.sqrt((error**2).mean()) * 1e3),
        p95_ms=float(np.quantile(np.abs(error), 0.95) * 1e3),
        z_rms=float(np.sqrt((z**2).mean())),
        within=float((np.abs(z) < NORMAL).mean()),
    )


def line(what: str, found: Offsets) -> str:
    """Return a row of the table in docs/alignment.md."""
    return (
        f"| {what} | {found.throws} | {found.mean_ms:+.3f} / {found.rms_ms:.3f} / {found.p95_ms:.3f} | "
        f"{found.z_rms:.2f} | {found.within:.0%} |"
    )


def run(arm: Arm, kind: Kind, seeds: range) -> dict[str, Any]:
    """Film throws of one kind and align them; return all numbers."""
    errors: list[tuple[float, float]] = []
    told: dict[str, list[tuple[float, float]]] = {}
    false = switchings = 0
    rejected: list[str] = []
    look_s = []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            throw = film(arm, kind, seed, Path(folder))
        off_s, sigma_s, wrong = switch_errors(throw)
        errors += zip(off_s, sigma_s, strict=True)
        false, switchings = false + wrong, switchings + len(throw.record.sync_events)
        rejected += throw.led.rejected
        look_s.append(throw.look_s)
        for way, known in (("delay known", (KNOWN_S, KNOWN_SD_S)), ("delay unknown", (0.0, UNKNOWN_SD_S))):
            for name, row in offsets_of(arm, throw, *known).items():
                if name != "fit alone" or way == "delay known":
                    told.setdefault(name if name == "fit alone" else f"{name}, {way}", []).append(row)
    return {
        "kind": asdict(kind),
        "switchings": switchings,
        "false": false,
        "rejected": rejected,
        "look_us": float(np.mean(look_s) * 1e6),
        "edges": asdict(offsets(errors)),
        "rows": told,
        "offsets": {name: asdict(offsets(rows)) for name, rows in told.items()},
    }


def main() -> None:
    """Print how the offset fares by LED, by fit and by both."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--throws", type=int, default=THROWS, help="of each kind")
    parser.add_argument("--first", type=int, default=700, help="seed of the first throw")
    options = parser.parse_args()
    arm = load_arm(ARM_FILE)
    results: list[dict[str, Any]] = []
    for kind in KINDS:
        found = run(arm, kind, range(options.first, options.first + options.throws))
        results.append(found)
        print(
            f"{kind}: {found['switchings']} switchings, {found['false']} false, rejected "
            f"{found['rejected']}; {found['look_us']:.0f} µs a frame",
            file=sys.stderr,
        )
        print(line("switchings", Offsets(**found["edges"])), file=sys.stderr)
        for name, one in found["offsets"].items():
            print(line(name, Offsets(**one)), file=sys.stderr, flush=True)
    print("all:", file=sys.stderr)
    for name in results[0]["rows"]:
        rows = [row for found in results for row in found["rows"].get(name, [])]
        print(line(name, offsets(rows)), file=sys.stderr)
    json.dump(results, sys.stdout, indent=2, allow_nan=False)
    print()


if __name__ == "__main__":
    main()
