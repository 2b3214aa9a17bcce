"""By how much the tip missed the target: verdict.json."""

from __future__ import annotations

from pathlib import Path

from strandcast.experiment import PointObjective, SegmentObjective, ShapeObjective, SwingObjective
from strandcast.records.alignment import Alignment
from strandcast.records.track import TrackSummary, read_track
from strandcast.stages.context import context_of
from strandcast.verdict import judge, not_judged


def run(root: Path, name: str, trial: int) -> None:
    """Judge one trial."""
    context = context_of(root, name)
    settings, folder = context.settings, context.folder.trial(trial).results
    unjudged = _unjudged(settings.objective)
    if unjudged is not None:
        kind = settings.objective.kind
        not_judged(settings.target_m, settings.hit_radius_m, name, trial, kind, unjudged).write(
            folder / "verdict.json"
        )
        return
    points = TrackSummary.read(folder / "track.json").points
    judge(
        read_track(folder / "track.parquet", points),
        Alignment.read(folder / "alignment.json"),
        settings.target_m,
        settings.hit_radius_m,
        name,
        trial,
        settings.objective.ends_m if isinstance(settings.objective, SegmentObjective) else None,
    ).write(folder / "verdict.json")


def _unjudged(objective: PointObjective | SegmentObjective | ShapeObjective | SwingObjective) -> str | None:
    """Return why the track cannot tell whether an objective was reached, None where it can."""
    if isinstance(objective, ShapeObjective | SwingObjective):
        return f"no miss is told of a {objective.kind} from the track yet: see the throw's pictures"
    if isinstance(objective, PointObjective) and (
        objective.direction_rad is not None or objective.least_speed_m_s > 0.0
    ):
        return "no direction or speed of the tip at the target is judged from the track yet"
    return None
