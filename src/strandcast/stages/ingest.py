"""Raw video, joint log and played motion to manifest.json: hashes, counts, time stamps, gaps."""

from __future__ import annotations

from pathlib import Path

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.joint_log import JointLog, Run, read_run
from strandcast.records.manifest import LogFacts, Manifest
from strandcast.records.motion import Motion
from strandcast.stages.context import context_of
from strandcast.video.checks import check_cover, check_recorded, unchanged, warnings_of
from strandcast.video.ingest import inspect_video


def run(root: Path, name: str, trial: int) -> None:
    """Write results/<experiment>/trial-NN/manifest.json; the raw files stay as they are."""
    context = context_of(root, name)
    folder, camera = context.folder.trial(trial), context.settings.camera
    path = folder.video()
    with unchanged(path):
        video = inspect_video(path, camera.frame_rate_hz, camera.missing_policy)
    played_run, joint_log = read_run(folder.data) if (folder.data / "run.json").is_file() else (None, None)
    log = None if played_run is None or joint_log is None else _log_facts(played_run, joint_log)
    check_recorded(path, video, played_run)
    check_cover(path, video, played_run)
    played = None if folder.played_motion is None else Motion.read(folder.played_motion)
    motion = None if played is None else played.content_sha256()
    if played_run is not None and motion is not None:
        _check_played(folder.data, played_run, motion)
    Manifest(
        experiment=name,
        trial=trial,
        video=video,
        joint_log=log,
        motion_sha256=motion,
        warnings=warnings_of(video, log) + _log_warnings(log) + _foreign(played, name, trial),
    ).write(folder.results / "manifest.json")


def _log_facts(run_record: Run, log: JointLog) -> LogFacts:
    return LogFacts(
        file="joints.csv",
        sha256=run_record.joints_sha256,
        rows=run_record.rows,
        start_s=float(log.time_s[0]),
        end_s=float(log.time_s[-1]),
        rate_hz=run_record.timing.rate_hz,
        gaps=run_record.timing.gaps,
        duplicates=run_record.timing.duplicates,
    )


def _check_played(data: Path, run_record: Run, played: str) -> None:
    """Hold the motion beside the raw files against what run.json says was played."""
    said = run_record.motion_sha256
    if said is not None and said != played:
        raise StrandcastError(
            "SC-X020",
            "is not the motion that run.json says was played",
            file=data / "motion.json",
            cost="the fit would be made for another motion",
            fix="copy the folder again from the machine that played the motion",
            exit_code=INTEGRITY,
        )


def _foreign(played: Motion | None, name: str, trial: int) -> list[str]:
    """Tell of a motion that was planned for another throw: a repeated one, or a folder in the wrong place."""
    if played is None or (played.experiment, played.trial) == (name, trial):
        return []
    return [f"motion.json was planned for {played.experiment} trial {played.trial}"]


def _log_warnings(log: LogFacts | None) -> list[str]:
    if log is None:
        return []
    found = []
    if log.gaps:
        worst = max(gap.duration_s for gap in log.gaps)
        found.append(f"{log.file}: {len(log.gaps)} gaps, up to {worst:.4f} s")
    if log.duplicates:
        found.append(f"{log.file}: {log.duplicates} rows with the time of the one before")
    return found
