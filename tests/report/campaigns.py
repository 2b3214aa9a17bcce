"""A synthetic campaign in summaries: fifty experiments of twenty throws, by the package's own writer."""

from pathlib import Path

import numpy as np

from strandcast.records.summary import ExperimentSummary, TrialSummary, VersionGroup
from strandcast.report.campaign import Campaign, CampaignExperiment, WaitingTrial

HIT_RADIUS_M = 0.02
UNREAD = {"verdict.json": "does not fit the content: the file was changed"}
# What is planted: experiment and trial -> fields of its line.
PLANTED = {
    (3, 4): {"miss_m": 0.9, "hit": False},  # far above all others
    (4, 2): {"clock_drift": 5e-4},
    (5, 3): {"marker_fraction": 0.5},
    (6, 1): {"miss_m": None, "miss_sigma_m": None, "hit": None, "unread": UNREAD},
    (7, 2): {"miss_m": None, "miss_sigma_m": None, "hit": False},  # not seen
    (8, 5): {"excluded": "the string <slipped>"},
}


def summary_of(position: int, throws: int = 20) -> ExperimentSummary:
    """Return the summary of one experiment: its misses fall from 100 mm by a fifth per throw."""
    rng = np.random.default_rng(position)
    lines = []
    for trial in range(1, throws + 1):
        miss_m = 0.1 * 0.8 ** (trial - 1) * float(rng.uniform(0.7, 1.3))
        line = TrialSummary(
            trial=trial,
            miss_m=miss_m,
            miss_sigma_m=0.0009,
            hit=miss_m <= HIT_RADIUS_M,
            E_planned_m=0.02,
            E_m=float(rng.uniform(0.002, 0.004)),
            tracked_fraction=0.99,
            alignment_offset_s=0.731,
            alignment_offset_se_s=1.5e-4,
            predicted_p10_m=0.3 * miss_m,
            predicted_p90_m=1.2 * miss_m,
            clock_drift=float(rng.normal(0.0, 2e-5)),
            lens_rms_px=0.11,
            plane_rms_px=float(rng.uniform(0.2, 0.5)),
            marker_fraction=0.999,
            servo_residual_rad=1.2e-3,
        )
        planted = PLANTED.get((position, trial), {})
        lines.append(line.model_copy(update=planted))
    counted = [line for line in lines if line.excluded is None]
    decisive = next((line for line in counted if line.hit or line.hit is None), None)
    return ExperimentSummary(
        experiment=name_of(position),
        string_length_m=0.3,
        target_m=[0.5, 0.5],
        hit_radius_m=HIT_RADIUS_M,
        verdict="no hit" if decisive is None else "hit" if decisive.hit else "unknown",
        hit_trial=decisive.trial if decisive is not None and decisive.hit else None,
        trials=lines,
        next_motion_sha256=None,
        made_with=[VersionGroup(versions={"strandcast": "0.2.0"}, files=["trial-01/verdict.json"])],
    )


def name_of(position: int) -> str:
    return f"string-{position:02d}"


def write_summaries(root: Path, count: int = 50) -> None:
    """Write a project of experiments that have summaries, and one that has none."""
    for position in range(count):
        (root / "data" / name_of(position)).mkdir(parents=True)
        (root / "data" / name_of(position) / "experiment.yaml").write_text("title: planted\n")
        summary_of(position).write(root / "results" / name_of(position) / "summary.json")


def campaign_in_memory(count: int = 12, throws: int = 20) -> Campaign:
    names = {position: name_of(position) for position in range(count)}
    experiments = [CampaignExperiment(name, summary_of(position, throws)) for position, name in names.items()]
    waiting = (WaitingTrial(21), WaitingTrial(22, "track: SC-V005 the file is cut off"))
    experiments.append(CampaignExperiment(name_of(count), summary_of(count, 2), waiting=waiting))
    experiments.append(CampaignExperiment("unread", None, "summary.json: was changed; delete it"))
    return Campaign(experiments)
