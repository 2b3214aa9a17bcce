"""A track and an alignment that were measured elsewhere, verified and taken into the results."""

from __future__ import annotations

import shutil
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.records.alignment import HAND, Alignment
from strandcast.records.files import atomic_write
from strandcast.records.tables import read_table
from strandcast.records.track import TRACK, TrackSummary
from strandcast.stages.context import context_of


def run(root: Path, name: str, trial: int) -> None:
    """Copy track, summary, alignment and hand from data/ to results/, each after a verified read."""
    context = context_of(root, name)
    folder = context.folder.trial(trial)
    points = read_table(folder.data / "track.parquet", TRACK)["point"]
    read_table(folder.data / "hand.parquet", HAND)
    Alignment.read(folder.data / "alignment.json")
    summary = TrackSummary.read(folder.data / "track.json")
    if summary.points != context.settings.string.n or points.max() > summary.points:
        raise StrandcastError(
            "SC-I020",
            f"the track has {summary.points} points, the experiment's string {context.settings.string.n}",
            file=folder.data / "track.json",
            field="points",
            fix="set string.points in experiment.yaml, or import the track again",
        )
    for file in ("track.parquet", "track.json", "alignment.json", "hand.parquet"):
        with atomic_write(folder.results / file) as temporary:
            shutil.copyfile(folder.data / file, temporary)
