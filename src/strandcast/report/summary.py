"""summary.json: one experiment in numbers."""

from collections.abc import Mapping
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.records.motion import Motion
from strandcast.records.summary import ExperimentSummary, TrialSummary
from strandcast.report.expected import expected_miss
from strandcast.report.provenance import version_groups
from strandcast.report.results import TrialResults, read_results


def summarise(
    experiment: str,
    trials: Mapping[int, Path],
    *,
    string_length_m: float,
    target_m: list[float] | None,
    hit_radius_m: float,
    excluded: Mapping[int, str] | None = None,
    next_motion: Path | None = None,
) -> ExperimentSummary:
    """Return the summary of an experiment.

    `trials` are folders of results by trial, including excluded trials; values that cannot be read are null.
    `excluded` gives the reason why a trial does not count; such a trial cannot be the hit.
    """
    excluded = excluded or {}
    results = {trial: read_results(folder) for trial, folder in sorted(trials.items())}
    lines = [trial_summary(trial, each, excluded.get(trial)) for trial, each in results.items()]
    next_sha256, unread = _hash_of(next_motion)
    counted = [line for line in lines if line.excluded is None]
    decisive = next((line for line in counted if line.hit or line.hit is None), None)
    return ExperimentSummary(
        experiment=experiment,
        string_length_m=string_length_m,
        target_m=target_m,
        hit_radius_m=hit_radius_m,
        verdict="no target"
        if target_m is None
        else "no hit"
        if decisive is None
        else "hit"
        if decisive.hit
        else "unknown",
        hit_trial=decisive.trial if decisive is not None and decisive.hit else None,
        trials=lines,
        next_motion_sha256=next_sha256,
        unread=unread,
        made_with=version_groups({trials[trial].name: each for trial, each in results.items()}),
    )


def _hash_of(motion: Path | None) -> tuple[str | None, dict[str, str]]:
    """Return the hash of the next motion, and why it could not be read."""
    if motion is None:
        return None, {}
    try:
        return Motion.read(motion).content_sha256(), {}
    except StrandcastError as problem:
        return None, {f"{motion.parent.name}/{motion.name}": problem.what}


def trial_summary(trial: int, results: TrialResults, excluded: str | None) -> TrialSummary:
    """Return one row of the summary."""
    verdict, estimate = results.get("verdict"), results.get("estimate")
    track, alignment = results.get("track_summary"), results.get("alignment")
    camera, expected = results.get("camera"), expected_miss(results.get("motion"))
    servo = estimate.servo if estimate else None
    return TrialSummary(
        trial=trial,
        miss_m=verdict.miss_m if verdict else None,
        miss_sigma_m=verdict.miss_sigma_m if verdict else None,
        hit=verdict.hit if verdict else None,
        E_planned_m=estimate.E_planned_m if estimate else None,
        E_m=estimate.E_m if estimate else None,
        tracked_fraction=track.tracked_fraction if track else None,
        alignment_offset_s=alignment.offset_s if alignment else None,
        alignment_offset_se_s=alignment.offset_se_s if alignment else None,
        predicted_p10_m=expected.low_m if expected else None,
        predicted_p90_m=expected.high_m if expected else None,
        clock_drift=alignment.drift if alignment else None,
        lens_rms_px=camera.lens.rms_px if camera else None,
        plane_rms_px=camera.plane_rms_px if camera else None,
        marker_fraction=track.marker_fraction if track else None,
        servo_residual_rad=max((each for each in servo.residual_rad if each is not None), default=None)
        if servo
        else None,
        excluded=excluded,
        unread=results.unread(),
    )
