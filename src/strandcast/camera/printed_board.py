"""The ChArUco board that photos show, read from the order of its markers, compared with the declared one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np

from strandcast.camera.markers import (
    FAMILIES,
    PatternedBoard,
    detect_markers,
    eight_bit,
    enough,
    marker_detector,
    opencv_board,
    patterned,
)
from strandcast.config.camera import Board
from strandcast.errors import StrandcastError

TRIED = 4  # chosen: photos that are searched in other ways if they do not show the declared board
LEAST_MARKERS = 4  # side by side in one photo, to read their order; a board of 3 x 3 squares has four
MAJORITY = 0.5  # chosen: least share of the markers that fit one order
SQUARES = range(3, 51)  # in a row, as `Board`
REFERENCES = 12  # chosen: markers of a photo from which the others are counted
OFF_LATTICE = 0.3  # chosen: squares; an oblique view stretches a step to the next marker by less
OTHER_SIZE = 0.07  # chosen: relative, of the markers; blur makes small ones up to 0.06 smaller
DRAWN_PX = 16  # chosen: of a square, in the drawing with which a photo is compared
LEAST_SEEN = 0.4  # chosen: share of a row or column in a photo; of less, a small shift is its neighbour
PRINTED = 0.4  # chosen: least correlation of a row or column that is printed with its drawing

Photos = Sequence[tuple[str, np.ndarray]]
SeenAs = Callable[[np.ndarray], np.ndarray]
# Ids (m,), their columns and rows (m, 2) from any one of them, and a square's side in sides of a marker.
Patch = tuple[np.ndarray, np.ndarray, float]
# A photo in 8 bits as it is searched, the ids (m,) of its markers and their corners (m, 4, 2).
Seen = tuple[np.ndarray, np.ndarray, np.ndarray]
Line = tuple[int | None, int | None]  # of a board: (row, None) or (None, column)


@dataclass(frozen=True)
class PrintedBoard:
    """The board with its pattern, and warnings where it is not as declared."""

    board: PatternedBoard
    warnings: list[str]
    white_on_black: bool = False
    of_size: Sequence[str] = ()  # the warnings about the sizes of markers and squares
    is_shown: bool = False  # all its rows and columns are in a photo
    # Its pattern is not the usual one, and its rows and columns that no photo shows might be others.
    is_open: bool = False

    def black_on_white(self, grey: np.ndarray) -> np.ndarray:
        """Return a photo (height, width) with the board black on white."""
        return _negative(grey) if self.white_on_black else grey


@dataclass(frozen=True)
class MarkerOrder:
    """The squares per row, the number that id 0 has in the order, and the rows and columns seen (from, to).

    Also a square's side in sides of a marker. Markers are numbered row by row over the white squares (column
    + row odd) of a pattern that begins with a black square: marker k lies on square 2 k + 1 of an odd row
    length.
    """

    squares_x: int
    number_of_id_0: int
    rows: tuple[int, int]
    columns: tuple[int, int]
    square_in_markers: float

    def last_id(self) -> int:
        """Return the id of the last marker of the last row."""
        return (self.rows[1] + 1) * self.squares_x // 2 - self.number_of_id_0 - 1

    def first_id(self, top: int) -> int:
        """Return the first id of a board that begins with a row of the order."""
        return top * self.squares_x // 2 - self.number_of_id_0


class PossibleBoard(NamedTuple):
    """A board with the declared squares on which the markers seen are in their places."""

    board: PatternedBoard  # with its own pattern and first id
    unseen: list[Line]  # rows and columns of it in which no marker was seen
    last_row: int  # in which one was


def identify_board(photos: Photos, board: Board, field: str = "camera.board") -> PrintedBoard:
    """Return the board that photos (name, grey) show; the declared one if they show too little of any.

    Its pattern, OpenCV's legacy one or not, its first id, and whether it is white on black are taken as the
    photos show them. `field` is where the experiment declares the board.

    Raises
    ------
    StrandcastError
        SC-C016 the board has other squares or another dictionary; SC-C023 the photos are mirrored.
    """
    board = patterned(board)
    dictionaries = [board.dictionary, *(name for name in FAMILIES if name != board.dictionary)]
    few = photos[:: max(len(photos) // TRIED, 1)][:TRIED]
    for name, seen_as in product(dictionaries, (_as_it_is, _negative, _mirrored)):
        orders = _orders(few, board, name, seen_as)
        candidates = _candidates(orders, board)
        if len(orders) != 1 and not (candidates and name == board.dictionary):
            continue
        if name != board.dictionary:
            right, larger = enough(name, orders[0].last_id())
            what = f"the board's markers are from {right}{larger}, not from {board.dictionary}"
            fix = f"set {field}.dictionary to {right}"
            raise StrandcastError("SC-C016", what, field=f"{field}.dictionary", fix=fix)
        if seen_as is _mirrored:
            fix = "turn mirroring off in the camera's software, or remove the mirror"
            raise StrandcastError("SC-C023", "the board photos are mirrored", file=photos[0][0], fix=fix)
        white_on_black = seen_as is _negative
        warnings = [
            "the board is white on black, or its photos are negatives: taken as such"
        ] * white_on_black
        of_size = _of_other_size(orders[0], board, field)
        if len(candidates) != 1 or candidates[0].board != board:
            orders = _orders(photos, board, name, seen_as) or orders  # a few may not show its outer rows
            candidates = _candidates(orders, board)
        if not candidates:
            raise _of_other_squares(orders[0], board, field)
        is_cut_off = any(each.unseen for each in candidates)
        seen = [_seen(grey, name, seen_as) for _, grey in photos] if is_cut_off else []
        likeness = [[_likeness(line, seen, each.board) for line in each.unseen] for each in candidates]
        possible = [k for k, each in enumerate(likeness) if min(each, default=1.0) >= PRINTED]
        best = possible[0] if possible else 0
        printed = candidates[best]
        for (row, _), alike in zip(printed.unseen, likeness[best], strict=True):
            if row is not None and row > printed.last_row and alike < PRINTED:
                raise _other_squares(board, board.squares_x, row, field)
        is_shown = np.inf not in likeness[best]
        is_rival = len(possible) > 1 or any(each.board == board for each in candidates)
        return PrintedBoard(
            printed.board,
            [*warnings, *of_size],
            white_on_black,
            of_size,
            is_shown,
            is_open=printed.board != board and is_rival and not is_shown,
        )
    return PrintedBoard(board, [])


def _candidates(orders: Sequence[MarkerOrder], board: PatternedBoard) -> list[PossibleBoard]:
    """Return the boards with the declared squares that have one of several orders, the likeliest first."""
    found = []
    for order in orders:
        (first, last), (left, right) = order.rows, order.columns
        for top in range(last - board.squares_y + 1, first + 1):
            white_first = top % 2  # as OpenCV's legacy pattern with an even number of rows
            same_squares = order.squares_x == board.squares_x and not (white_first and board.squares_y % 2)
            if not same_squares or order.first_id(top) < 0:
                continue
            legacy = bool(white_first) if board.squares_y % 2 == 0 else board.legacy
            unseen: list[Line] = [
                *((row, None) for row in range(board.squares_y) if not first <= row + top <= last),
                *((None, column) for column in range(board.squares_x) if not left <= column <= right),
            ]
            pattern = {"legacy": legacy, "first_id": order.first_id(top)}
            found.append(PossibleBoard(board.model_copy(update=pattern), unseen, last - top))
    return sorted(
        found, key=lambda each: (abs(each.board.first_id - board.first_id), each.board.legacy != board.legacy)
    )


def _as_it_is(grey: np.ndarray) -> np.ndarray:
    return grey


def _negative(grey: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.bitwise_not(eight_bit(grey)))


def _mirrored(grey: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(grey[:, ::-1])


def _of_other_squares(order: MarkerOrder, board: Board, field: str) -> StrandcastError:
    """Return the refusal of a board with other squares than the declared ones, as its order has them."""
    x, y = order.squares_x, order.rows[1] - order.rows[0] + 1
    y += y % 2 * (order.rows[0] % 2)  # boards that begin with a white square have an even number of rows
    if x == board.squares_y:  # exchanged; a photo may not show all rows
        y = max(y, board.squares_x)
    return _other_squares(board, x, y, field)


def _other_squares(board: Board, x: int, y: int, field: str) -> StrandcastError:
    what = f"the board has {x} x {y} squares, not {board.squares_x} x {board.squares_y}"
    fix = f"set squares_x: {x} and squares_y: {y}"
    if (x, y) == (board.squares_x + 1, board.squares_y + 1):
        what += ": squares are counted, not the corners between them"
    elif x != board.squares_x and y < board.squares_y and (y, x) != (board.squares_x, board.squares_y):
        what += f", if a photo shows all of its {y} rows"
        fix = f"set squares_x: {x}, and squares_y to the rows of the board"
    return StrandcastError("SC-C016", what, field=field, fix=fix)


def _of_other_size(order: MarkerOrder, board: Board, field: str) -> list[str]:
    """Return a warning if markers or squares have not the declared size."""
    marker_m, square_m = board.square_m / order.square_in_markers, board.marker_m * order.square_in_markers
    if abs(board.marker_m / marker_m - 1.0) < OTHER_SIZE:
        return []
    return [
        f"beside squares of {1e3 * board.square_m:g} mm, the board's markers measure about "
        f"{1e3 * marker_m:.1f} mm, not {1e3 * board.marker_m:g}: measure both, and set {field}.marker_m to "
        f"{marker_m:.4f} or square_m to {square_m:.4f}"
    ]


def _seen(grey: np.ndarray, dictionary: str, seen_as: SeenAs) -> Seen:
    grey = eight_bit(seen_as(grey))
    return grey, *detect_markers(grey, marker_detector(dictionary))


def _likeness(line: Line, seen: Sequence[Seen], board: PatternedBoard) -> float:
    """Return the correlation of a board's line with what photos show there; infinite: it is in none."""
    pattern = opencv_board(board)
    width, height = board.squares_x * DRAWN_PX, board.squares_y * DRAWN_PX
    drawn = pattern.generateImage((width, height))
    row, column = (
        slice(None) if each is None else slice(each * DRAWN_PX, (each + 1) * DRAWN_PX) for each in line
    )
    places = np.asarray(pattern.getObjPoints())[:, :, :2] * DRAWN_PX / board.square_m
    likeness = []
    for grey, ids, corners_px in seen:
        on_board = np.isin(ids, pattern.getIds())
        if on_board.sum() < LEAST_MARKERS:
            continue
        to_drawing, _ = cv2.findHomography(
            corners_px[on_board].reshape(-1, 2),
            places[ids[on_board] - board.first_id].reshape(-1, 2),
            cv2.RANSAC,
            0.5 * DRAWN_PX,
        )
        if to_drawing is None:
            continue
        shown, whole = (
            cv2.warpPerspective(each, to_drawing, (width, height))[row, column]
            for each in (grey, np.full_like(grey, 255))
        )
        inside = whole == 255
        if inside.mean() >= LEAST_SEEN:
            both = np.stack([shown[inside], drawn[row, column][inside]]).astype(float)
            both -= both.mean(axis=1, keepdims=True)
            likeness.append(float(both[0] @ both[1] / max(np.prod(np.linalg.norm(both, axis=1)), 1.0)))
    return max(likeness, default=np.inf)


def _orders(photos: Photos, board: PatternedBoard, dictionary: str, seen_as: SeenAs) -> list[MarkerOrder]:
    """Return the orders that most markers fit; none if it is not clear.

    Several if an outer column is in no photo: then those with the declared squares in a row, or first id.
    """
    detector = marker_detector(dictionary)
    detected = (detect_markers(seen_as(grey), detector) for _, grey in photos)
    patches = [patch for ids, corners_px in detected for patch in _patches(ids, corners_px)]
    if not patches:
        return []
    squares_x, number_of_id_0 = np.array([(x, number) for x in SQUARES for number in range(x)]).T
    fitting = sum(_fitting(patch, squares_x, number_of_id_0).sum(axis=1) for patch in patches)
    best = np.flatnonzero(fitting == fitting.max())
    if fitting[best[0]] < MAJORITY * sum(len(ids) for ids, *_ in patches):
        return []
    top = int(board.legacy and board.squares_y % 2 == 0)
    with_its_ids = number_of_id_0 == (top * (squares_x // 2) - board.first_id) % squares_x
    kinds = (each[best] for each in (squares_x == board.squares_x, with_its_ids) if each[best].any())
    best = best[next(kinds, slice(None))]
    return [_as_order(patches, squares_x[[each]], number_of_id_0[[each]]) for each in best]


def _as_order(patches: Sequence[Patch], squares_x: np.ndarray, number_of_id_0: np.ndarray) -> MarkerOrder:
    """Return an order (arrays of one) with the rows and columns of the markers that fit it."""
    order = squares_x, number_of_id_0
    places = np.concatenate([_squares(each[0], *order)[0, _fitting(each, *order)[0]] for each in patches])
    columns, rows = ((int(each.min()), int(each.max())) for each in places.T)
    size = float(np.median([each[2] for each in patches]))
    return MarkerOrder(int(squares_x[0]), int(number_of_id_0[0]), rows, columns, size)


def _squares(ids: np.ndarray, squares_x: np.ndarray, number_of_id_0: np.ndarray) -> np.ndarray:
    """Return the column and row of each id (m,) in several orders (h,): (h, m, 2)."""
    x, numbers = squares_x[:, None], ids + number_of_id_0[:, None]
    row = (2 * numbers + 1) // x
    column = np.where(x % 2, (2 * numbers + 1) % x, 2 * numbers % x + (row + 1) % 2)
    return np.stack([column, row], axis=-1)


def _fitting(patch: Patch, squares_x: np.ndarray, number_of_id_0: np.ndarray) -> np.ndarray:
    """Return which markers of a patch fit several orders (h,), where most of them do: (h, m)."""
    ids, cells, _ = patch
    shifts = _squares(ids, squares_x, number_of_id_0) - cells
    references = np.unique(np.linspace(0, len(ids) - 1, REFERENCES).astype(int))
    same = (shifts[:, references, None] == shifts[:, None]).all(axis=-1)  # (h, references, m)
    return np.asarray(same[np.arange(len(same)), same.sum(axis=2).argmax(axis=1)])


def _patches(ids: np.ndarray, corners_px: np.ndarray) -> list[Patch]:
    """Return the markers that lie side by side as on a ChArUco board, counted in squares from one another."""
    if len(ids) < LEAST_MARKERS:
        return []
    centre = corners_px.mean(axis=1)
    right, down = (
        0.5 * (corners_px[:, one] - corners_px[:, other]).sum(axis=1)
        for one, other in (([1, 2], [0, 3]), ([2, 3], [1, 0]))
    )
    axes = np.linalg.inv(np.stack([right, down], axis=2))  # a degenerate marker is not detected
    sides = np.einsum("iab,ijb->ija", axes, centre[None] - centre[:, None])  # from i to j, in sides of i
    far = np.abs(sides).max(axis=2)
    np.fill_diagonal(far, np.inf)
    each, nearest = np.arange(len(ids)), far.argmin(axis=1)  # the diagonal neighbour
    apart = np.linalg.norm(sides, axis=2)
    square = float(np.median(np.sqrt(0.5 * apart[each, nearest] * apart[nearest, each])))
    squares = sides / square
    steps = np.rint(squares).astype(int)
    near = (np.abs(steps).max(axis=2) <= 2) & (steps.sum(axis=2) % 2 == 0) & (steps != 0).any(axis=2)
    near &= (np.abs(squares - steps) < OFF_LATTICE * np.abs(steps).max(axis=2, keepdims=True)).all(axis=2)
    near &= (steps == -steps.swapaxes(0, 1)).all(axis=2)
    patches, free = [], np.ones(len(ids), bool)
    while free.any():
        cells = {int(np.argmax(free)): np.zeros(2, int)}
        for member in (queue := list(cells)):
            free[member] = False
            for neighbour in np.flatnonzero(near[member] & free):
                cells[int(neighbour)] = cells[member] + steps[member, neighbour]
                free[neighbour] = False
                queue.append(int(neighbour))
        if len(cells) >= LEAST_MARKERS:
            patches.append((ids[list(cells)], np.array(list(cells.values())), square))
    return patches
