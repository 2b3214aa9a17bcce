"""Print calibration boards and marker sheets at true size, as PDF (vector) or PNG (with its dpi)."""

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Outline

from strandcast.camera.markers import marker_cells, opencv_board
from strandcast.config.camera import Board
from strandcast.errors import StrandcastError
from strandcast.records.files import atomic_write

PAGES_MM = {"A4": (210, 297), "A3": (297, 420), "A2": (420, 594), "A1": (594, 841), "A0": (841, 1189)}
MARGIN_MM = 12.0  # chosen: printers leave up to 6 mm blank
FOOTER_MM = 22.0  # chosen: height of the ruler and the caption below the pattern
QUIET_ZONE_SHARE = 0.2  # chosen: white border around a marker that detectors need, relative to its side
RULER_MM = 100


def write_charuco(board: Board, path: str | Path, title: str = "ChArUco board", dpi: int = 600) -> list[Path]:
    """Write a ChArUco board at true size, on the smallest page that it fits, and return the files written.

    `path` ends in ``.pdf`` (vector) or ``.png`` (with `dpi` in its metadata). The caption begins
    with `title`.
    """
    width_mm, height_mm = board.squares_x * board.square_m * 1e3, board.squares_y * board.square_m * 1e3
    figure, axes, page_mm = _page(PAGES_MM, width_mm, height_mm)
    left, bottom = (page_mm[0] - width_mm) / 2, FOOTER_MM + (page_mm[1] - FOOTER_MM - height_mm) / 2
    _fill(axes, charuco_cells_mm(board) + np.array([left, bottom, 0.0, 0.0]))
    caption = (
        f"{title}: {board.squares_x} x {board.squares_y} squares "
        f"of {board.square_m * 1e3:g} mm, "
        f"markers {board.marker_m * 1e3:g} mm, {board.dictionary}, "
        f"ids 0-{board.squares_x * board.squares_y // 2 - 1}"
    )
    _draw_footer(axes, caption, page_mm)
    return _save([figure], Path(path), dpi)


def write_markers(
    ids: Sequence[int],
    size_m: float,
    dictionary: str,
    path: str | Path,
    title: str = "ArUco markers",
    dpi: int = 600,
) -> list[Path]:
    """Write single ArUco markers at true size with ids and cutting lines, as many per A4 page as fit.

    Several pages become one PDF, or PNG files numbered ``name-1.png``, ``name-2.png`` …
    `size_m` is the side of the black square; see `write_charuco` for the others.
    """
    if len(set(ids)) != len(ids) or not ids:
        what = f"marker ids {list(ids)} are empty or contain one twice"
        raise StrandcastError("SC-C002", what, field="ids", fix="give each id once")
    side_mm = size_m * 1e3
    pitch_mm = side_mm * (1 + 2 * QUIET_ZONE_SHARE) + 4.0
    _, _, page_mm = _page(["A4"], pitch_mm, pitch_mm)
    across = int((page_mm[0] - 2 * MARGIN_MM) // pitch_mm)
    down = int((page_mm[1] - FOOTER_MM - MARGIN_MM) // pitch_mm)
    figures = []
    for start in range(0, len(ids), across * down):
        on_page = list(ids[start : start + across * down])
        figure, axes, _ = _page(["A4"], pitch_mm, pitch_mm)
        for place, marker in enumerate(on_page):
            u_mm = MARGIN_MM + pitch_mm * (place % across + 0.5)
            v_mm = page_mm[1] - MARGIN_MM - pitch_mm * (place // across + 0.5)
            cells, label = marker_cells(dictionary, marker), f"{dictionary} id {marker}"
            _draw_marker(axes, cells, np.array([u_mm, v_mm]), side_mm, pitch_mm, label)
        listed = ", ".join(str(marker) for marker in on_page)
        caption = f"{title}: {dictionary}, ids {listed}, side {side_mm:g} mm"
        _draw_footer(axes, caption, page_mm)
        figures.append(figure)
    return _save(figures, Path(path), dpi)


def charuco_cells_mm(board: Board) -> np.ndarray:
    """Return the black rectangles (N, 4) [mm]: left, bottom, width, height; origin bottom left, y up."""
    pattern = opencv_board(board)
    square, height = board.square_m * 1e3, board.squares_y * board.square_m * 1e3
    rectangles, white = [], set()
    for marker, corners in zip(np.asarray(pattern.getIds()).reshape(-1), pattern.getObjPoints(), strict=True):
        left, top = np.asarray(corners).reshape(4, -1)[0, :2] * 1e3  # the board's y runs down its image
        white.add((int(left // square), int(top // square)))
        cells = marker_cells(board.dictionary, int(marker))
        rectangles += _runs_mm(cells, left, height - top, board.marker_m * 1e3)
    for row in range(board.squares_y):
        for column in range(board.squares_x):
            if (column, row) not in white:
                rectangles.append((column * square, height - (row + 1) * square, square, square))
    return np.array(rectangles)


def _runs_mm(
    cells: np.ndarray, left_mm: float, top_mm: float, side_mm: float
) -> list[tuple[float, float, float, float]]:
    """Return a marker's black cells as rectangles, merged along rows."""
    cell = side_mm / len(cells)
    rectangles = []
    for row, line in enumerate(cells):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(np.int8), [0]])))
        bottom = top_mm - (row + 1) * cell
        for start, stop in edges.reshape(-1, 2):
            rectangles.append((left_mm + start * cell, bottom, (stop - start) * cell, cell))
    return rectangles


def _page(
    pages: Collection[str], width_mm: float, height_mm: float
) -> tuple[Figure, Axes, tuple[float, float]]:
    """Return an empty page, axes in millimetres, the first of `PAGES_MM` on which a pattern fits."""
    for name in pages:
        for page_mm in (PAGES_MM[name], PAGES_MM[name][::-1]):
            if width_mm <= page_mm[0] - 2 * MARGIN_MM and height_mm <= page_mm[1] - MARGIN_MM - FOOTER_MM:
                figure = Figure(figsize=(page_mm[0] / 25.4, page_mm[1] / 25.4), facecolor="white")
                FigureCanvasAgg(figure)
                axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0, page_mm[0]), ylim=(0, page_mm[1]))
                axes.axis("off")
                return figure, axes, (float(page_mm[0]), float(page_mm[1]))
    what = f"a pattern of {width_mm:.0f} x {height_mm:.0f} mm does not fit {name}"
    fix = "sizes are in metres: 40 mm is 0.04"
    raise StrandcastError("SC-C002", what, field="board", fix=fix)


def _fill(axes: Axes, rectangles_mm: np.ndarray) -> None:
    """Fill all rectangles as one path: separate patches would show light seams."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    points = rectangles_mm[:, None, :2] + corners[None] * rectangles_mm[:, None, 2:]
    codes = [Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY]
    outline = Outline(points.reshape(-1, 2), np.tile(codes, len(points)))
    axes.add_patch(PathPatch(outline, facecolor="black", linewidth=0, snap=False))


def _draw_marker(
    axes: Axes, cells: np.ndarray, centre_mm: np.ndarray, side_mm: float, pitch_mm: float, label: str
) -> None:
    left, top = centre_mm[0] - side_mm / 2, centre_mm[1] + side_mm / 2
    _fill(axes, np.array(_runs_mm(cells, left, top, side_mm)))
    corner = centre_mm - pitch_mm / 2
    axes.add_patch(
        Rectangle((corner[0], corner[1]), pitch_mm, pitch_mm, fill=False, edgecolor="0.75", linewidth=0.3)
    )
    axes.text(centre_mm[0], corner[1] + 1.0, label, ha="center", va="bottom", fontsize=5, color="0.4")


def _draw_footer(axes: Axes, caption: str, page_mm: tuple[float, float]) -> None:
    """Draw the caption and a ruler to compare with a real one."""
    left, base = (page_mm[0] - RULER_MM) / 2, 11.0
    axes.plot([left, left + RULER_MM], [base, base], color="black", linewidth=0.5, solid_capstyle="butt")
    for tick in range(0, RULER_MM + 1, 10):
        top = base + (3.0 if tick % 50 == 0 else 1.5)
        axes.plot([left + tick] * 2, [base, top], color="black", linewidth=0.3)
    note = f"this ruler is {RULER_MM} mm long: print at 100 %, not fitted to the page"
    axes.text(page_mm[0] / 2, base - 1.0, note, ha="center", va="top", fontsize=6)
    fontsize = min(7, page_mm[0] / len(caption) * 4)
    axes.text(page_mm[0] / 2, base + 4.0, caption, ha="center", va="bottom", fontsize=fontsize)


def _save(figures: list[Figure], path: Path, dpi: int) -> list[Path]:
    if path.suffix.lower() == ".pdf":
        with atomic_write(path) as temporary, PdfPages(temporary, metadata={"CreationDate": None}) as pages:
            for figure in figures:
                pages.savefig(figure)
        return [path]
    if path.suffix.lower() != ".png":
        what = f"cannot write a board as {path.suffix or 'a file without suffix'}"
        fix = "choose a file name that ends in .pdf or .png"
        raise StrandcastError("SC-E005", what, file=path, fix=fix)
    numbered = [path]
    if len(figures) > 1:
        numbered = [path.with_stem(f"{path.stem}-{number + 1}") for number in range(len(figures))]
    for figure, file in zip(figures, numbered, strict=True):
        with atomic_write(file) as temporary:
            figure.savefig(temporary, dpi=dpi, metadata={"Software": None})
    return numbered
