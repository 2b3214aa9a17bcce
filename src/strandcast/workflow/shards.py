"""Shards: which jobs a cluster runs as one of its own, and what memory and time they ask for.

A job of a cluster starts Snakemake twice, which costs as much as a small stage. So the stages of an
experiment form groups; a profile says how many throws of a recorded experiment make one job.
On a single machine, groups and requests have no effect.
"""

import math

from strandcast.core.trial_names import trial_name
from strandcast.records.folders import files_of_video
from strandcast.records.listing import size_bytes_of
from strandcast.stages.producers import BY_CAMERA, JOIN
from strandcast.workflow.targets import experiment, supplied_trials

# What a throw needs before it is fitted. In the lab, the next throw depends on the fit: all is one chain.
OF_A_THROW = (*BY_CAMERA, JOIN, "score")
THROWS = "throws"  # ends the names of these groups; a profile's `group-components` says how many are merged

# Measured: the two Snakemakes of a job take 350 MB; stages of the demo at most 450 MB, but `track` 613 MB.
SNAKEMAKE_MB = 400
PEAK_MB, TRACK_PEAK_MB = SNAKEMAKE_MB + 600, SNAKEMAKE_MB + 900
PER_VIDEO_MB = 2.0  # chosen: what a large video may add, as file and frames wait in memory
TIME_MIN, TRACK_MIN = 5, 10  # chosen: ten times what the stages of the demo take
VIDEO_MB_PER_MIN = 20.0  # chosen: the tracker reads about 10 MB of compressed video per second of one core


def shard_of(stage: str, name: str, trial: int = 0) -> str | None:
    """Return the name of the group of a job; None for one that runs by itself.

    All jobs of an experiment are one group, but for recorded throws: their videos are tracked in groups of
    their own, at the same time, and the calibration that they need runs before. In the lab, the verdicts
    decide what the experiment's page is made from: Snakemake plans that job again after each of them, and
    would submit its group a second time.
    """
    if experiment(name).settings.lab is not None:
        return None if stage == "summary" else name
    name = experiment(name).folder.experiment  # a camera's jobs are of the throws of its experiment
    if stage == "calibrate":
        return None
    if stage in OF_A_THROW and trial_name(trial) not in supplied_trials().get(name, ()):
        return f"{name}.{THROWS}"
    return name


def memory_mb(stage: str, name: str, trial: int = 0, attempt: int = 1) -> int:
    """Return the memory that a job asks for [MB]: by the size of its video, doubled after each failure."""
    least = TRACK_PEAK_MB if stage == "track" else PEAK_MB
    more = PER_VIDEO_MB * video_mb(name, trial) if stage == "track" else 0.0
    return math.ceil(least + more) << (attempt - 1)


def runtime_min(stage: str, name: str, trial: int = 0, attempt: int = 1) -> int:
    """Return the time that a job asks for [min]: by the size of its video, longer after each failure."""
    least = TRACK_MIN if stage == "track" else TIME_MIN
    more = video_mb(name, trial) / VIDEO_MB_PER_MIN if stage in (*OF_A_THROW, "lab_throw") else 0.0
    return math.ceil(least + more) * attempt


def video_mb(name: str, trial: int) -> float:
    """Return the size of a trial's video [MB]; 0 for one that does not exist yet, or is a link to nowhere."""
    videos = experiment(name).folder.trial(trial).videos() if trial else []
    files = [file for video in videos for file in files_of_video(video)]
    return sum(map(size_bytes_of, files)) / 1e6
