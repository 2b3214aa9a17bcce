"""summary.json: one experiment in numbers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from strandcast.records.motion import Motion
from strandcast.records.summary import Summary, TrialSummary
from strandcast.report.results import Results, read_results


def summarise(
    experiment: str,
    trials: Mapping[int, Path],
    *,
    string_length_m: float,
    target_m: list[float],
    hit_radius_m: float,
    excluded: Mapping[int, str] | None = None,
    next_motion: Path | None = None,
) -> Summary:
    """Return the summary of an experiment.

    Parameters
    ----------
    experiment
        Its name.
    trials
        Trial -> its folder of results, the excluded ones among them; what cannot be read there is null.
    string_length_m, target_m, hit_radius_m
        From the experiment's file [m].
    excluded
        Trial -> why it does not count; such a trial cannot be the hitting one.
    next_motion
        The motion that would be played next.
    """
    excluded = excluded or {}
    lines = [
        trial_summary(trial, read_results(folder), excluded.get(trial))
        for trial, folder in sorted(trials.items())
    ]
    hits = [line.trial for line in lines if line.hit and line.excluded is None]
    return Summary(
        experiment=experiment,
        string_length_m=string_length_m,
        target_m=target_m,
        hit_radius_m=hit_radius_m,
        hit_trial=hits[0] if hits else None,
        trials=lines,
        next_motion_sha256=None if next_motion is None else Motion.read(next_motion).content_sha256(),
    )


def trial_summary(trial: int, results: Results, excluded: str | None) -> TrialSummary:
    """Return one trial's line."""
    verdict, estimate = results.get("verdict"), results.get("estimate")
    track, alignment = results.get("track_summary"), results.get("alignment")
    return TrialSummary(
        trial=trial,
        miss_m=verdict.miss_m if verdict else None,
        miss_sigma_m=verdict.miss_sigma_m if verdict else None,
        hit=bool(verdict and verdict.hit),
        E_planned_m=estimate.E_planned_m if estimate else None,
        E_m=estimate.E_m if estimate else None,
        tracked_fraction=track.tracked_fraction if track else None,
        alignment_offset_s=alignment.offset_s if alignment else None,
        alignment_offset_se_s=alignment.offset_se_s if alignment else None,
        excluded=excluded,
    )
