"""The benefit of a sync LED: filmed throws with known clocks, aligned with and without it.

``python -m strandcast_studies.evidence.led [--throws N]`` prints a table to standard error and JSON to
standard output; docs/explanation/alignment.md has the figures. The alignment uses the lab's exact camera, so
that only the pictures of markers and LED link the clocks.
"""

import argparse
import json
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.alignment.align import RobotData, VideoData, align
from strandcast.alignment.events import clock_of_events
from strandcast.alignment.led import led_events, pair_led
from strandcast.arm.load import PlanarArm, load_arm
from strandcast.config.align import AlignSettings, LedSettings
from strandcast.config.experiment import Experiment
from strandcast.core.trajectory import JointTrajectory
from strandcast.errors import StrandcastError
from strandcast.executor.drivers.protocol import Recording
from strandcast.lab.driver import VIDEO, LabDriver, LabThrow
from strandcast.lab.led import LATENCY_S
from strandcast.lab.led import led_times as lab_switched
from strandcast.records.camera import Camera, Lens
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.tables import read_facts
from strandcast.records.track import DetectedLed
from strandcast.seeds import rng
from strandcast.tracking.crops import Crops
from strandcast.tracking.decoding import decode
from strandcast.tracking.events.led import LedMonitor
from strandcast.tracking.hand.finder import HandFinder
from strandcast.tracking.hand.path import marker_table
from strandcast.tracking.pixel_map import tabulate
from strandcast.video.ingest import camera_times, inspect_video
from strandcast_studies.evidence.clock_trials import ARM_FILE, TrueClock
from strandcast_studies.evidence.clocks import NORMAL, rms

FREE_M, IN_THE_WAY_M = (0.60, 0.76), (0.62, 0.05)  # LED beside the string's path, and behind it
MARKERS_M = ((-0.25, 0.75), (0.3, 0.76), (0.85, 0.75), (-0.25, -0.4), (0.3, -0.42), (0.85, -0.4))
TARGET_M = (0.55, 0.35)
KNOWN_S, KNOWN_SD_S = 0.5 * sum(LATENCY_S), (LATENCY_S[1] - LATENCY_S[0]) / 12**0.5
UNKNOWN_SD_S = 5e-4
DRIFT_PRIOR = 5e-5
FALSE_S = 0.03  # a detected switching farther than this from every true one is false; chosen


@dataclass(frozen=True)
class LedCase:
    """A camera and the place of the LED."""

    rate_hz: float
    exposure_s: float
    noise_grey: float = 2.5
    place_m: tuple[float, float] = FREE_M


CASES = (
    LedCase(120.0, 4e-4),
    LedCase(120.0, 6e-3),
    LedCase(240.0, 4e-4, 6.0),
    LedCase(240.0, 3e-3),
    LedCase(500.0, 4e-4),
    LedCase(500.0, 1.6e-3, 6.0),
    LedCase(240.0, 1e-3, place_m=IN_THE_WAY_M),
)


def experiment_of(kind: LedCase) -> Experiment:
    """Return the virtual rig of a case."""
    markers = [{"id": k, "x_m": x, "y_m": y} for k, (x, y) in enumerate(MARKERS_M)]
    camera = {
        "size_px": (640, 512),
        "frame_rate_hz": kind.rate_hz,
        "exposure_s": kind.exposure_s,
        "noise_grey": kind.noise_grey,
    }
    return Experiment.model_validate(
        {
            "string": {"length_m": 0.3},
            "target_m": TARGET_M,
            "workspace_m": {"x_m": (-0.32, 0.92), "y_m": (-0.48, 0.82)},
            "cameras": {"main": {"plane": {"size_m": 0.08, "markers": markers}}},
            "align": {"led": {"place_m": kind.place_m}},
            "lab": {"camera": camera},
        }
    )


def command_of(arm: PlanarArm, random: np.random.Generator) -> JointTrajectory:
    """Return a random swing: each joint moves from rest to rest by its own angle in its own time."""
    cycle_s = 1.0 / arm.log_rate_hz
    duration_s = float(random.uniform(0.35, 0.6))
    time_s = np.arange(round(duration_s / cycle_s) + 1) * cycle_s
    late, by = random.uniform(0.0, 0.3, 3), random.uniform(0.4, 0.9, 3)
    s = np.clip((time_s[:, None] / time_s[-1] - late) / (1.0 - late), 0.0, 1.0)
    q = np.array([0.3, -0.6, -0.5]) + by * s**3 * (10 - 15 * s + 6 * s**2)
    qd = np.gradient(q, cycle_s, axis=0)
    return JointTrajectory(time_s, q, qd, np.gradient(qd, cycle_s, axis=0))


@dataclass(frozen=True, eq=False)
class FilmedLedThrow(TrueClock):
    """A filmed throw and its truth."""

    markers: dict[str, np.ndarray]
    led: DetectedLed
    record: Recording
    latency_s: float
    look_s: float  # CPU time of the LED's window, per frame


def film(arm: PlanarArm, kind: LedCase, seed: int, folder: Path, gamma: float | None = 1.0) -> FilmedLedThrow:
    """Throw in the lab, then detect markers and LED in the film as tracking does."""
    settings = experiment_of(kind).model_copy(update={"seed": seed})
    name, truth = f"led-{round(kind.rate_hz)}", folder / "truth.parquet"
    command = command_of(arm, rng(name, seed, 0, "swing"))
    driver = LabDriver(LabThrow(name, settings, 1, truth), arm)
    driver.move_to_start(command.q_rad[0])
    record = driver.play(command, folder)
    facts = read_facts(truth, LAB_TRUTH)
    camera = camera_of(facts["camera"], settings)
    video = inspect_video(folder / VIDEO)
    finder = HandFinder(camera, arm.markers, arm.marker_dictionary, 0.0)
    monitor = TimedMonitor(LedSettings(place_m=kind.place_m, gamma=gamma), camera)
    decoded = decode(folder / VIDEO, video, finder, Crops(tabulate(camera, 0.0), 0.3), [monitor.look])
    time_s = camera_times(video)
    lamp = lab_switched(record.motion_end_s - record.motion_start_s, rng(name, seed, 1, "lab-led"))
    return FilmedLedThrow(
        markers=marker_table(finder, decoded.hands, time_s),
        led=monitor.found(time_s, kind.exposure_s)[0],
        record=record,
        offset_s=facts["offset_s"],
        drift=facts["drift"],
        latency_s=lamp.latency_s,
        look_s=monitor.cpu_s / len(time_s),
    )


class TimedMonitor(LedMonitor):
    """Measures its own CPU time."""

    cpu_s = 0.0

    def look(self, image: np.ndarray) -> None:
        """Take in a frame."""
        before_s = time.thread_time()
        super().look(image)
        self.cpu_s += time.thread_time() - before_s


def camera_of(truth: dict[str, Any], settings: Experiment) -> Camera:
    """Return the lab's camera as an error-free calibration."""
    assert settings.lab is not None
    width_px, height_px = settings.lab.camera.size_px
    lens = Lens(
        width_px=width_px,
        height_px=height_px,
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


def switch_errors(throw: FilmedLedThrow) -> tuple[list[float], list[float], int]:
    """Return the errors of the switching times [s], their sigmas, and the number of false switchings."""
    errors, sigmas, false = [], [], 0
    for event in throw.led.events:
        true_s = [e.time_s + throw.latency_s for e in throw.record.sync_events if e.kind == event.kind]
        off_s = min((throw.robot_s(event.camera_time_s) - at_s for at_s in true_s), key=abs, default=1.0)
        if abs(off_s) > FALSE_S:
            false += 1
        else:
            errors.append(off_s)
            sigmas.append(event.sigma_s)
    return errors, sigmas, false


def offsets_of(
    arm: PlanarArm, throw: FilmedLedThrow, latency_s: float, latency_sd_s: float
) -> dict[str, tuple[float, float]]:
    """Return error and standard error of the middle offset: LED alone, fit alone, both."""
    log, recorded = throw.record.log, throw.record.sync_events
    led = LedSettings(place_m=(0.0, 0.0), latency_s=(latency_s, latency_sd_s))
    found: dict[str, tuple[float, float]] = {}
    pairs = pair_led(throw.led.events, led_events(log, recorded), led, None).events
    if pairs:
        clock, covariance, middle_s = clock_of_events(pairs, 0.0, DRIFT_PRIOR)
        found["LED alone"] = (float(clock[0]) - throw.robot_s(middle_s), float(np.sqrt(covariance[0, 0])))
    for name, with_led in (("fit alone", None), ("both", throw.led)):
        try:
            video, robot = VideoData(throw.markers, with_led), RobotData(log, recorded)
            fit = align(video, robot, arm, AlignSettings(led=led), experiment="led", trial=1)
        except StrandcastError as refusal:
            print(f"{name}: {refusal.code}", file=sys.stderr)
            continue
        found[name] = throw.error_s(fit)
    return found


def offsets(rows: list[tuple[float, float]]) -> dict[str, float]:
    """Return the statistics of errors and standard errors (T, 2); z is error over standard error."""
    error, sigma = np.array(rows).T
    z = error / sigma
    return {
        "throws": len(rows),
        "mean_ms": float(error.mean() * 1e3),
        "rms_ms": rms(error) * 1e3,
        "p95_ms": float(np.quantile(np.abs(error), 0.95) * 1e3),
        "z_rms": rms(z),
        "within": float((np.abs(z) < NORMAL).mean()),
    }


def line(name: str, found: dict[str, float]) -> str:
    """Return a row of the table in docs/explanation/alignment.md."""
    row = "| {throws} | {mean_ms:+.3f} / {rms_ms:.3f} / {p95_ms:.3f} | {z_rms:.2f} | {within:.0%} |"
    return f"| {name} " + row.format(**found)


def run(arm: PlanarArm, kind: LedCase, seeds: range) -> dict[str, Any]:
    """Film and align the throws of one case; return all numbers."""
    errors: list[tuple[float, float]] = []
    found: dict[str, list[tuple[float, float]]] = {}
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
                    found.setdefault(name if name == "fit alone" else f"{name}, {way}", []).append(row)
    return {
        "kind": asdict(kind),
        "switchings": switchings,
        "false": false,
        "rejected": rejected,
        "look_us": float(np.mean(look_s) * 1e6),
        "edges": offsets(errors),
        "rows": found,
        "offsets": {name: offsets(rows) for name, rows in found.items()},
    }


def main() -> None:
    """Print the offsets' errors by LED, by fit and by both."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--throws", type=int, default=3, help="throws per case")
    parser.add_argument("--first", type=int, default=700, help="seed of the first throw")
    options = parser.parse_args()
    arm = load_arm(ARM_FILE).planar()
    results: list[dict[str, Any]] = []
    for kind in CASES:
        found = run(arm, kind, range(options.first, options.first + options.throws))
        results.append(found)
        print(
            f"{kind}: {found['switchings']} switchings, {found['false']} false, rejected "
            f"{found['rejected']}; {found['look_us']:.0f} µs a frame",
            file=sys.stderr,
        )
        for name, one in [("switchings", found["edges"]), *found["offsets"].items()]:
            print(line(name, one), file=sys.stderr, flush=True)
    print("all:", file=sys.stderr)
    for name in results[0]["rows"]:
        rows = [row for found in results for row in found["rows"].get(name, [])]
        print(line(name, offsets(rows)), file=sys.stderr)
    print(json.dumps(results, indent=2, allow_nan=False))


if __name__ == "__main__":
    main()
