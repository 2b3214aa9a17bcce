"""The provenance section of a page: versions, hashes, seeds and settings."""

from collections.abc import Iterable, Mapping

from strandcast.core.trial_names import in_trial_order
from strandcast.records.files import sha256_file
from strandcast.records.summary import VersionGroup, group_by_versions
from strandcast.report.facts import Facts
from strandcast.report.numbers import UNKNOWN
from strandcast.report.panels.content import Table
from strandcast.report.results import FILES, TrialResults

HASHED = ("manifest", "motion", "track_summary", "alignment", "estimate")


def version_groups(trials: Mapping[str, TrialResults]) -> list[VersionGroup]:
    """Return which results were made by which versions; `trials` by the names of their folders."""
    made_by: dict[str, dict[str, str]] = {}
    for folder, results in trials.items():
        for name, versions in results.made_by.items():
            made_by.setdefault(f"{folder}/{results.file(name)}".replace(f"{folder}/../", ""), versions)
    return group_by_versions(made_by.items())


def mixed_versions(groups: list[VersionGroup]) -> str | None:
    """Return a sentence if the results of a page were made by different versions."""
    if len(groups) < 2:
        return None
    return f"The results on this page were made by {len(groups)} different sets of versions."


def version_tables(groups: list[VersionGroup]) -> list[Table]:
    """Return a table of versions for each group of files."""
    tables = []
    for group in groups:
        rows = [list(pair) for pair in group.versions.items()] or [["unknown", "not stored in these files"]]
        caption = f"Made with these versions: {', '.join(group.files)}." if len(groups) > 1 else ""
        tables.append(Table(["software", "version"], rows, caption))
    return tables


def settings_tables(facts: Facts) -> list[Table]:
    """Return the experiment's settings as a table, if they are known."""
    rows = [list(pair) for pair in facts.flat_settings()]
    return [Table(["setting", "value"], rows)] if rows else []


def trial_provenance(results: TrialResults, groups: list[VersionGroup], facts: Facts) -> list[Table]:
    """Return the tables of a trial's page: hashes, seeds, versions and settings."""
    paths = {results.file(name): results.path(name) for name in FILES}
    files = [[name, sha256_file(path)] for name, path in paths.items() if path.is_file()]
    return [
        Table(["file of results", "sha256"], files),
        Table(["raw data and seeds", "value"], _origins(results)),
        *version_tables(groups),
        *settings_tables(facts),
    ]


def experiment_provenance(
    trials: Mapping[int, TrialResults], groups: Iterable[VersionGroup], facts: Facts
) -> list[Table]:
    """Return the tables of an experiment's page: hashes, versions and settings."""
    rows = [
        [f"trial {trial}: {name}", record.content_sha256()]
        for trial, results in trials.items()
        for name in HASHED
        if (record := results.get(name)) is not None
    ]
    hashes = Table(["record", "content sha256"], rows)
    return [hashes, *version_tables(list(groups)), *settings_tables(facts)]


def _origins(results: TrialResults) -> list[list[str]]:
    rows = []
    manifest, estimate, motion = (results.get(name) for name in ("manifest", "estimate", "motion"))
    if manifest is not None:
        rows.append([f"video {manifest.video.file}, sha256", manifest.video.sha256])
        log = manifest.joint_log
        rows += [[f"joint log {log.file}, sha256", log.sha256]] if log is not None else []
        rows.append(["motion as played, content sha256", manifest.motion_sha256 or UNKNOWN])
    if motion is not None:
        rows.append(["motion as planned, content sha256", motion.content_sha256()])
        if motion.provenance is not None:
            made_from = motion.provenance.planned_from
            rows.append(["seed of the plan", str(motion.provenance.seed)])
            rows += [[f"planned from {name}", made_from[name]] for name in in_trial_order(made_from)]
    if estimate is not None:
        rows.append(["seed of the estimate", str(estimate.seed)])
        made_from = estimate.planned_from
        rows += [[f"estimated from {name}", made_from[name]] for name in in_trial_order(made_from)]
    return rows
