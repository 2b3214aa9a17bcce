"""Rows 55 to 58, 64, 65 and 81 of the fault list: faults of the computer end in one clear sentence."""

import os
import resource
from pathlib import Path

import pytest

from .conftest import write_film
from .hosts import keep_hard_limits, run_mounted, run_python, small_disk

OPEN = """
from strandcast.video.reader import open_video
with open_video(Path({!r})) as video:
    print(sum(1 for _ in video), "frames")
"""


def test_row57_a_full_disk_keeps_the_old_file_and_names_the_new_one(tmp_path: Path) -> None:
    found = run_mounted(
        small_disk(tmp_path),
        f"""
folder = Path({str(tmp_path)!r})
from strandcast.records.files import write_text
write_text(folder / "result.json", "old")
try:
    write_text(folder / "result.json", 3_000_000 * "n")
finally:
    print((folder / "result.json").read_text(), *(path.name for path in folder.iterdir()))
""",
    )
    assert found.splitlines()[0] == "old result.json"
    assert (
        f"SC-R041 ERROR  {tmp_path}/result.json: there is no room for it (No space left on device): " in found
    )
    assert "3 MB needed, 1.0" in found


@pytest.mark.parametrize(
    ("name", "write"),
    [
        (
            "strobe.webp",
            "from strandcast.camera.picture_file import write_picture\nwrite_picture(path, pixels, 100)",
        ),
        (
            "track.parquet",
            "from strandcast.records.files import atomic_write\nimport pyarrow as pa, pyarrow.parquet as pq\n"
            "with atomic_write(path) as new:\n    pq.write_table(pa.table({'a': pixels.ravel()}), new)",
        ),
        (
            "video.mp4",
            "from strandcast.lab.video import write_video\n"
            "write_video(path, (p for p in pixels.reshape(-1, 200, 200)), 200, 200, 500.0, {'crf': '0'})",
        ),
        (
            "camera.webp",
            "from strandcast.records.files import atomic_write\nfrom PIL import Image\n"
            "with atomic_write(path) as new:\n    Image.fromarray(pixels).save(new, 'WEBP', quality=99)",
        ),
    ],
)
def test_row58_every_writer_reports_a_full_disk(tmp_path: Path, name: str, write: str) -> None:
    found = run_mounted(
        small_disk(tmp_path),
        f"""
import numpy as np
pixels = np.random.default_rng(1).integers(0, 255, (1600, 2000), np.uint8)
path = Path({str(tmp_path / name)!r})
try:
    {write.replace(chr(10), chr(10) + "    ")}
finally:
    print([path.name for path in path.parent.iterdir()])
""",
    )
    assert found.splitlines()[0] == "[]"
    assert f"SC-R041 ERROR  {tmp_path / name}: there is no room for it (No space left on device)" in found


def test_row64_a_read_only_folder_is_named(tmp_path: Path) -> None:
    found = run_mounted(
        f"mount --bind {tmp_path} {tmp_path}; mount -o remount,bind,ro {tmp_path}",
        "from strandcast.records.files import write_text\n"
        f"write_text({str(tmp_path / 'a' / 'b.json')!r}, 'text')",
    )
    assert f"SC-W002 ERROR  {tmp_path}/a/b.json: cannot be written (Read-only file system)" in found


CHECK = "from strandcast.workflow.doctor import check_host\ncheck_host(Path({!r}), ['a'])\nprint('ready')"


def test_row55_without_any_folder_to_write_to_strandcast_can_be_imported() -> None:
    read_only = "".join(
        f"mount --bind {folder} {folder}; mount -o remount,bind,ro {folder}; "
        for folder in ("/tmp", "/var/tmp")
    )
    code = "import os, strandcast\nprint(os.environ.get('NUMBA_CACHE_DIR'))"
    assert run_mounted(read_only + "cd /tmp", code, HOME="/dev/null/home") == "None\n"


def test_row56_a_full_disk_stops_a_run_before_it_begins(tmp_path: Path) -> None:
    found = run_mounted(small_disk(tmp_path, "20m"), CHECK.format(str(tmp_path)))
    assert f"SC-R041 ERROR  {tmp_path}/.snakemake: there is no room for it" in found
    assert "150 MB needed, 21 MB free on this disk" in found


def test_row64_read_only_results_stop_a_run_but_raw_files_may_be_read_only(tmp_path: Path) -> None:
    for place in ("data/a", "results/a"):
        (tmp_path / place).mkdir(parents=True)
    for place, words in (
        ("data", "ready"),
        ("results", f"SC-W002 ERROR  {tmp_path}/results/a: cannot be written (Read-only file system)"),
    ):
        folder = tmp_path / place
        mounts = f"mount --bind {folder} {folder}; mount -o remount,bind,ro {folder}"
        assert run_mounted(mounts, CHECK.format(str(tmp_path))).startswith(words)


def test_row81_a_hard_memory_limit_is_not_the_videos_fault(tmp_path: Path) -> None:
    film = write_film(tmp_path / "v.mp4")

    def limits() -> None:
        keep_hard_limits()
        resource.setrlimit(resource.RLIMIT_AS, (1_200_000_000, 1_200_000_000))

    found = run_python(OPEN.format(str(film)), limits=limits)
    assert found == "60 frames\n"


def test_row81_a_decoder_without_memory_says_so(tmp_path: Path) -> None:
    """The limit is what the reader's own libraries take, and a little more: too little for the decoder."""
    film = write_film(tmp_path / "v.mp4")
    limited = """
import resource
import strandcast.video.reader
pages = int(Path("/proc/self/statm").read_text().split()[0])
size = pages * resource.getpagesize() + (16 << 20)
resource.setrlimit(resource.RLIMIT_AS, (size, size))
"""
    found = run_python(limited + OPEN.format(str(film)), OPENBLAS_NUM_THREADS="1")
    what = "its decoder may need 2.0 GiB of memory, but `ulimit -v` allows 0."
    assert f"SC-W004 ERROR  {film}: {what}" in found


def test_a_limit_of_cpu_time_lets_short_videos_through(tmp_path: Path) -> None:
    film = write_film(tmp_path / "v.mp4")

    def limits() -> None:
        keep_hard_limits()
        resource.setrlimit(resource.RLIMIT_CPU, (60, 60))

    assert run_python(OPEN.format(str(film)), limits=limits) == "60 frames\n"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
def test_a_limit_of_processes_is_named(tmp_path: Path) -> None:
    film = write_film(tmp_path / "v.mp4")
    tmp_path.chmod(0o755)
    as_nobody = """
import os, resource
from strandcast.video.reader import open_video
os.setuid(65534)
resource.setrlimit(resource.RLIMIT_NPROC, (0, 0))
from strandcast.video.isolated import probe_isolated
"""
    found = run_python(as_nobody + "probe_isolated('v.mp4')", folder=film.parent)
    what = "its decoder could not be started (Resource temporarily unavailable), after 0 frames"
    assert f"SC-W004 ERROR  v.mp4: {what}" in found
    assert "`ulimit -a`" in found


def test_videos_are_decoded_without_tmp_and_shared_memory(tmp_path: Path) -> None:
    film = write_film(tmp_path / "v.mp4")
    mounts = "mount -t tmpfs -o size=4k none /dev/shm; mount --bind /tmp /tmp; mount -o remount,bind,ro /tmp"
    assert run_mounted(mounts, OPEN.format(str(film)), TMPDIR="/dev/null/no") == "60 frames\n"


def test_a_folder_for_temporary_files_is_asked_for(tmp_path: Path) -> None:
    code = """
import tempfile
tempfile._candidate_tempdir_list = lambda: ["/dev/null/no"]
from strandcast.records.files import open_scratch
open_scratch()
"""
    found = run_python(code)
    assert "SC-R041 ERROR  there is no folder for them: temporary files cannot be written" in found
    assert "TMPDIR" in found


@pytest.mark.parametrize(
    ("size", "side_px"), [("1m", 1400), ("4k", 80)]
)  # at once, or when a buffer is written
def test_a_full_disk_of_temporary_files_is_named_while_a_video_is_tracked(
    tmp_path: Path, size: str, side_px: int
) -> None:
    code = f"""
import numpy as np
from strandcast.core.pose import Pose
from strandcast.tracking.crops import Crops
from strandcast.tracking.pixel_map import PixelMap
corners = 700.0 * np.stack(np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0, 2.0]), axis=2)
kept = Crops(PixelMap(np.zeros(2), 1.0, corners, 1 / 700), 1.0)
kept.keep(np.ones(2 * ({side_px},), np.uint8), Pose(np.ones(2), np.zeros(())))
kept.at(0)
"""
    found = run_mounted(small_disk(tmp_path, size), code, TMPDIR=str(tmp_path))
    assert f"SC-R041 ERROR  {tmp_path}: temporary files cannot be written (No space left on device; " in found


@pytest.mark.parametrize("suffix", ["pdf", "png"])
def test_a_board_that_does_not_fit_on_the_disk_is_named(tmp_path: Path, suffix: str) -> None:
    code = """
from strandcast.camera.boards import _save
from matplotlib.figure import Figure
import numpy as np
figure = Figure()
figure.add_subplot().imshow(np.random.default_rng(1).random((300, 300)))
_save([figure], Path({!r}), 200)
"""
    path = tmp_path / f"board.{suffix}"
    found = run_mounted(small_disk(tmp_path, "8k"), code.format(str(path)))
    assert f"SC-R041 ERROR  {path}: there is no room for it" in found
