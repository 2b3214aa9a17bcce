"""Boards to print at true size: ChArUco for the lens, markers for the plane and the hand."""

from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.camera.boards import write_charuco, write_markers
from strandcast.stages.context import context_of


def run(root: Path, name: str, out: Path, suffix: str) -> list[Path]:
    """Write the boards as files in `out` and return their paths."""
    context = context_of(root, name)
    camera = next(iter(context.settings.cameras.values()))  # what several see is the first one's
    arm = load_arm(context.arm_file).planar()
    written = write_charuco(camera.board, out / f"lens-board.{suffix}", f"{name}: lens")
    ids = [marker.id for marker in camera.plane.markers]
    if ids:
        plane = out / f"plane-markers.{suffix}"
        written += write_markers(
            ids, camera.plane.size_m, camera.plane.dictionary, plane, f"{name}: plane of motion"
        )
    if camera.plane.board is not None:
        board_file = out / f"plane-board.{suffix}"
        written += write_charuco(camera.plane.board, board_file, f"{name}: plane of motion")
    for size_m in sorted({marker.size_m for marker in arm.markers}):
        hand = [marker.id for marker in arm.markers if marker.size_m == size_m]
        path = out / f"hand-markers-{size_m * 1000:g}mm.{suffix}"
        written += write_markers(hand, size_m, arm.marker_dictionary, path, f"{arm.name}: hand")
    return written
