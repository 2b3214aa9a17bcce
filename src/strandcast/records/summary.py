"""summary.json: one experiment in numbers."""

from collections.abc import Iterable, Mapping
from typing import ClassVar, Literal

from strandcast.records.record import Migration, Part, Record
from strandcast.records.verdict import Verdict


class TrialSummary(Part):
    """One row of the experiment's table of trials."""

    trial: int
    miss_m: float | None
    miss_sigma_m: float | None
    hit: bool | None  # null: unknown, or no target
    E_planned_m: float | None
    E_m: float | None
    tracked_fraction: float | None
    alignment_offset_s: float | None
    alignment_offset_se_s: float | None
    # The misses predicted before the throw: a tenth is less than the first, a tenth more than the second.
    predicted_p10_m: float | None = None
    predicted_p90_m: float | None = None
    # The rig; null: unknown.
    clock_drift: float | None = None
    lens_rms_px: float | None = None
    plane_rms_px: float | None = None
    marker_fraction: float | None = None  # of the frames in which the hand's markers were seen
    servo_residual_rad: float | None = None  # rms that the servo's model leaves, of the worst joint
    excluded: str | None = None  # the reason
    unread: dict[str, str] = {}  # results that could not be read -> why


TRIAL_COLUMNS = [name for name in TrialSummary.model_fields if name != "unread"]  # single values, for a table


def too_near(throw: Verdict | TrialSummary, hit_radius_m: float) -> bool:
    """Return whether a miss is within two standard deviations of the hit radius; unknown ones count as 0."""
    return throw.miss_m is not None and abs(throw.miss_m - hit_radius_m) < 2 * (throw.miss_sigma_m or 0.0)


def miss_in_words(throw: Verdict | TrialSummary, hit_radius_m: float) -> str:
    """Return whether a throw at a target hit, with a question mark if that is uncertain, and its miss."""
    if throw.miss_m is None:
        return "UNKNOWN: (the tip was not tracked to the target)"
    outcome = ("HIT" if throw.hit else "miss") + ("?" if too_near(throw, hit_radius_m) else "")
    sigma = "" if throw.miss_sigma_m is None else f" ± {1000 * throw.miss_sigma_m:.1f}"
    return f"{outcome:4} {1000 * throw.miss_m:.1f}{sigma} mm from the target"


class VersionGroup(Part):
    """Result files that were made by the same versions of strandcast and of its libraries."""

    versions: dict[str, str]  # empty: from before versions were stored
    files: list[str]


def group_by_versions(made_by: Iterable[tuple[str, Mapping[str, str]]]) -> list[VersionGroup]:
    """Return the names of files by the versions that made them, in order of first use."""
    groups: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for file, versions in made_by:
        groups.setdefault(tuple(sorted(versions.items())), []).append(file)
    return [VersionGroup(versions=dict(versions), files=files) for versions, files in groups.items()]


class ExperimentSummary(Record):
    """One experiment in numbers."""

    SCHEMA: ClassVar[str] = "strandcast/summary"
    VERSION: ClassVar[int] = 2
    MIGRATIONS: ClassVar[Mapping[int, Migration]] = {
        1: lambda old: old | {"verdict": "no hit" if old["hit_trial"] is None else "hit"}
    }

    experiment: str
    string_length_m: float
    target_m: list[float] | None  # null: none, the motion was only captured
    hit_radius_m: float
    # unknown: a result that it depends on could not be read
    verdict: Literal["hit", "no hit", "unknown", "no target"]
    hit_trial: int | None
    trials: list[TrialSummary]
    next_motion_sha256: str | None
    unread: dict[str, str] = {}  # results beside those of trials that could not be read -> why
    made_with: list[VersionGroup] = []  # one group if all results were made by the same versions

    def counted(self) -> list[TrialSummary]:
        """Return the trials that are not excluded."""
        return [line for line in self.trials if line.excluded is None]

    def all_unread(self) -> dict[str, str]:
        """Return why results could not be read, by file; those of excluded trials do not count."""
        files = {
            f"trial {line.trial}, {file}": why for line in self.counted() for file, why in line.unread.items()
        }
        return files | self.unread
