"""By how much a throw missed what it was for: verdict.json."""

from __future__ import annotations

from pathlib import Path

from strandcast.experiment import Experiment, SegmentObjective, ShapeObjective, SwingObjective
from strandcast.records.alignment import Alignment
from strandcast.records.track import TrackSummary, read_track
from strandcast.stages.context import context_of
from strandcast.verdict.judge import blank_verdict, judge, judge_moment
from strandcast.verdict.moment import Shape, Swing, Velocity


def run(root: Path, name: str, trial: int) -> None:
    """Judge one trial."""
    context = context_of(root, name)
    settings, folder = context.settings, context.folder.trial(trial).results
    told = TrackSummary.read(folder / "track.json")
    track = read_track(folder / "track.parquet", told.points)
    alignment = Alignment.read(folder / "alignment.json")
    aim = (settings.target_m, settings.hit_radius_m, name, trial)
    wanted = _wanted(settings)
    if wanted is None:
        bar = settings.objective.ends_m if isinstance(settings.objective, SegmentObjective) else None
        verdict = judge(track, alignment, *aim, bar)
    else:
        blank = blank_verdict(*aim, settings.objective.kind, str(wanted))
        verdict = judge_moment(track, alignment, wanted, told.length_m, blank)
    verdict.write(folder / "verdict.json")


def _wanted(settings: Experiment) -> Velocity | Shape | Swing | None:
    """Return what a throw is for, None where it is to come near a place or bar."""
    told = settings.objective
    if isinstance(told, ShapeObjective):
        return Shape(tuple(p.along_m for p in told.places), tuple(p.at_m for p in told.places))
    if isinstance(told, SwingObjective):
        return Swing(told.height_m, told.speed_m_s)
    if isinstance(told, SegmentObjective) or (told.direction_rad is None and told.least_speed_m_s == 0.0):
        return None
    return Velocity(settings.target_m, told.direction_rad, told.tolerance_rad, told.least_speed_m_s)
