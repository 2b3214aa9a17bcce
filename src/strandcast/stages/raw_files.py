"""Raw files that stages read and no stage makes: what to do about one that is missing."""

import shlex
from pathlib import Path

from strandcast.errors import StrandcastError
from strandcast.records.folders import parted
from strandcast.records.listing import entries_of
from strandcast.stages.context import Context

LENS_MISSING = {
    "photos": ("SC-C030", "lens", "photo or video of the lens board"),
    "video": ("SC-C030", "lens", "video of the lens board"),
    "file": ("SC-C050", "lens", "file of the lens"),
}
MOST_NAMED = 12  # files beside a missing one


def missing_file(context: Context, path: Path) -> StrandcastError:
    """Return the problem of a raw file that is not there, with the setting that names it if there is one."""
    experiment, camera = parted(context.name)
    of_camera = f"cameras.{camera}" if camera else "camera"
    photos = (
        f"if it is there under another name, rename it or set {of_camera}.lens; otherwise take 10 photos of "
        f"it (strandcast boards {shlex.quote(experiment)} prints it), all over the picture; motion capture "
        "needs none (strandcast import track)"
    )
    background, setting = context.settings.track.background_picture, "track.background_picture"
    named: list[tuple[str | None, str, str, str, str | None]] = [
        (background, "SC-T030", setting, "picture", None)
    ]
    for each in context.settings.cameras.values():
        code, field, what = LENS_MISSING[each.lens_kind]
        fix = photos if each.lens_kind == "photos" else None
        named.append((each.lens, code, f"{of_camera}.{field}", what, fix))
        named.append((each.plane_photo, "SC-C031", f"{of_camera}.plane_photo", "photo of the plane", None))
    for given, code, setting, what, fix in named:
        if given is not None and path == context.folder.data / given:
            beside = ", ".join(sorted(each.name for each in entries_of(path.parent))[:MOST_NAMED])
            found = f"there is no {what}; there: {beside or 'nothing'}"
            return StrandcastError(code, found, file=path, field=setting, fix=fix)
    return StrandcastError(
        "SC-V020",
        f"{path.name} is missing",
        file=path,
        fix="copy it from the computer that wrote the others, or import it: strandcast import --help",
    )
