"""Raw data and results in object storage, by Snakemake's storage plugins; settings stay where Snakemake runs.

Snakemake retrieves the files of a job, as its rule declares them, to a folder with the project's layout, and
stores what the job writes there. So stages run in that folder: their settings are copied to it, and a listing
of the storage says which files there are besides those of the job.
"""

import atexit
import filecmp
import os
import shutil
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, NamedTuple

from strandcast.errors import ENVIRONMENT, StrandcastError
from strandcast.records.files import atomic_write
from strandcast.records.listing import write_listing
from strandcast.workflow.targets import ROOT

SETTINGS = ("Snakefile", "workflow/Snakefile", "config/**/*", "data/*/*")  # only files, no folders


class ProjectStorage(NamedTuple):
    """A project's files in object storage.

    Attributes
    ----------
    folder
        Where stages run: Snakemake retrieves their files to it.
    found
        What the storage has, as Snakemake's cache of files.
    inventory
        Under this name the cache notes that it knows all files.
    """

    folder: Path
    found: Any
    inventory: str

    def inform(self, cache: Any) -> None:
        """Give Snakemake what was found, so that it asks the storage for no file by itself while it plans."""
        known = cache.exists_in_storage.has_inventory
        if cache.active and self.inventory not in known:
            cache.exists_in_storage.update(self.found.exists_in_storage)
            cache.mtime.update(self.found.mtime)
            cache.size.update(self.found.size)
            known.add(self.inventory)


def open_storage(workflow: Any) -> ProjectStorage | None:
    """List the object storage that Snakemake's settings name; None if all files are on disk.

    Parameters
    ----------
    workflow
        Snakemake's workflow.

    Raises
    ------
    StrandcastError
        SC-W037 the storage has no raw data of a project.
    """
    from snakemake.io import IOCache

    provider = workflow.storage_registry.default_storage_provider
    if provider is None:
        return None
    prefix = (workflow.storage_settings.default_storage_prefix or "").rstrip("/")
    page = provider.object(f"{prefix}/report.html")  # any file in the project's folder
    if not page.is_valid_query():
        raise _no_raw_data(prefix)
    folder, found = Path(page.local_path()).parent, IOCache(max_wait_time=0)
    workflow.async_run(page.inventory(found))
    sizes = {Path(path): size for path, size in found.size.items()}
    listed = {str(path.relative_to(folder)): size for path, size in sizes.items() if folder in path.parents}
    if not any(name.startswith(f"data{os.sep}") for name in listed):
        raise _no_raw_data(prefix)
    _copy_settings(folder)
    with NamedTemporaryFile(prefix="strandcast-listing-", suffix=".json", delete=False) as file:
        write_listing(listing := Path(file.name), listed)
    atexit.register(listing.unlink, missing_ok=True)
    return ProjectStorage(folder, found, page.get_inventory_parent())


def _no_raw_data(prefix: str) -> StrandcastError:
    return StrandcastError(
        "SC-W037",
        f"no raw data are found in {prefix}/data",
        field="default-storage-prefix",
        cost="nothing was run",
        fix="copy data/ there, or correct the prefix (s3://BUCKET/PROJECT), the endpoint or the credentials",
        exit_code=ENVIRONMENT,
    )


def is_setting(path: str) -> bool:
    """Return whether a file stays where Snakemake runs: in config/, or with an experiment.yaml."""
    match Path(path).parts:
        case ("config", *_) | ("data", _, _):
            return True
    return False


def _copy_settings(folder: Path) -> None:
    """Let the folder where stages run have just these settings; other jobs may read them there meanwhile."""
    settings = _settings_in(ROOT)
    for path in settings:
        copy = folder / path
        if not (copy.is_file() and filecmp.cmp(path, copy, shallow=False)):
            with atomic_write(copy) as temporary:
                shutil.copyfile(path, temporary)
    for path in _settings_in(folder) - settings:
        (folder / path).unlink(missing_ok=True)


def _settings_in(folder: Path) -> set[Path]:
    """Return the files in a project's folder that are settings, relative to it."""
    found = (path for pattern in SETTINGS for path in folder.glob(pattern))
    return {path.relative_to(folder) for path in found if path.is_file()}
