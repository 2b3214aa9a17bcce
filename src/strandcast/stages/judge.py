"""By how much the tip missed the target: verdict.json."""

from __future__ import annotations

from pathlib import Path

from strandcast.records.alignment import Alignment
from strandcast.records.track import TrackSummary, read_track
from strandcast.stages.context import context_of
from strandcast.verdict import judge


def run(root: Path, name: str, trial: int) -> None:
    """Judge one trial."""
    context = context_of(root, name)
    settings, folder = context.settings, context.folder.trial(trial).results
    points = TrackSummary.read(folder / "track.json").points
    judge(
        read_track(folder / "track.parquet", points),
        Alignment.read(folder / "alignment.json"),
        settings.target_m,
        settings.hit_radius_m,
        name,
        trial,
    ).write(folder / "verdict.json")
