"""Camera clock to robot clock: alignment.json and hand.parquet."""

from __future__ import annotations

from pathlib import Path

from strandcast.alignment.align import align
from strandcast.alignment.events import SeenEvent
from strandcast.alignment.hand_path import hand_table
from strandcast.alignment.led import Led
from strandcast.alignment.problem import Priors
from strandcast.arm.load import load_arm
from strandcast.experiment import AlignSettings
from strandcast.records.alignment import HAND
from strandcast.records.joint_log import read_run
from strandcast.records.motion import Motion
from strandcast.records.tables import read_table, write_table
from strandcast.records.track import MARKERS, TrackSummary
from strandcast.stages.context import context_of


def run(root: Path, name: str, trial: int) -> None:
    """Align one trial."""
    context = context_of(root, name)
    settings, folder = context.settings.align, context.folder.trial(trial)
    arm = load_arm(context.arm_file)
    played, log = read_run(folder.data)
    markers = read_table(folder.results / "markers.parquet", MARKERS)
    start_s, end_s = played.motion_start_s, played.motion_end_s
    planned = folder.played_motion
    predicted = Motion.read(planned).predicted if planned else None
    alignment = align(
        markers,
        log,
        arm,
        experiment=name,
        trial=trial,
        motion_s=None if start_s is None or end_s is None else (start_s, end_s),
        priors=Priors(drift=settings.drift_prior, known_drift=settings.known_drift),
        largest_offset_s=settings.largest_offset_s,
        seen_events=[
            SeenEvent(event.kind, event.camera_time_s, event.sigma_s)
            for event in settings.sync_events
            if event.trial == trial
        ],
        told_events=played.sync_events,
        led=_led(settings, folder.results / "track.json"),
        tip_speed_m_s=predicted.peak_tip_speed_m_s if predicted else None,
        log_file=str(folder.data / "joints.csv"),
    )
    alignment.write(folder.results / "alignment.json")
    write_table(folder.results / "hand.parquet", HAND, hand_table(alignment, markers, log, arm))


def _led(settings: AlignSettings, track: Path) -> Led | None:
    """Return what tracking saw of the LED; None where none was looked for."""
    seen = None if settings.led is None else TrackSummary.read(track).led
    if settings.led is None or seen is None:
        return None
    events = [SeenEvent(event.kind, event.camera_time_s, event.sigma_s) for event in seen.events]
    return Led(events, settings.led.latency_s, settings.led.latency_sd_s)
