"""Diagnosis of the plane's markers: wrong size, swapped, rotated, misplaced; and the error at the string.

More than 2 mm anywhere in the workspace is an error, more than 0.3 mm a warning.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from strandcast.camera.mapping import pixel_to_metre
from strandcast.camera.plane_error import PlaneBox, worst_difference_m
from strandcast.camera.pose import PlacedMarker, PoseFit, SizeFit, fit_pose, fit_size, posed
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera

ERROR_M, WARNING_M = 2e-3, 3e-4  # chosen
SIGNIFICANT = 4.0  # chosen: standard errors
POOR_PX = 1.0  # chosen: rms of a fit above which an explanation is searched
SIZE_ERROR, SIZE_WARNING = 0.02, 0.005  # chosen: relative
ONE_SIZE_ERROR = 0.03  # chosen: relative, of a single marker
EXPLAINED = 0.35  # chosen: largest rms, relative to the original fit's, under a correct explanation


@dataclass(frozen=True)
class MarkerLayout:
    """The detected markers as the experiment places them, and their corners (K, 4, 2) [px]."""

    markers: list[PlacedMarker]
    corners_px: np.ndarray
    camera: Camera
    fit: PoseFit
    workspace: PlaneBox
    file: str | None
    on_board: bool = False

    def cost_m(self, other: PoseFit) -> float:
        """Return the largest error [m] in the workspace if another pose is the true one."""
        return worst_difference_m(posed(self.camera, other), self.camera, self.workspace)

    def error(self, what: str, cost: str, fix: str, *, of_size: bool = False) -> StrandcastError:
        """Return an error in this photo, in the size of the markers or in their places."""
        if self.on_board:
            field = "board.marker_m" if of_size else "board"
        else:
            field = "size_m" if of_size else "markers"
        field = f"camera.plane.{field}"
        return StrandcastError("SC-C027", what, file=self.file, field=field, cost=cost, fix=fix)


def check_markers(layout: MarkerLayout) -> tuple[SizeFit, list[str]]:
    """Compare the markers with their declared size and positions.

    Return their size by their distances, and warnings of small deviations with the errors that they cause.

    Raises
    ------
    StrandcastError
        SC-C027 size or distances are wrong by more than 2 % and 2 mm, or one marker has another size or is
        out of the plane; one is misplaced, or no single cause explains the residuals; two are swapped, one is
        rotated, or the axes are not those of the world.
    """
    size = fit_size(layout.markers, layout.corners_px, layout.camera.lens)
    by_size = size.rms_px < POOR_PX
    off = abs(size.ratio - 1.0)
    costs = abs(1.0 / size.ratio - 1.0) * _reach_m(layout.workspace) > ERROR_M
    if by_size and off > max(SIZE_ERROR, SIGNIFICANT * size.error) and costs:
        raise _wrong_size(layout, size)
    poor = layout.fit.rms_px > POOR_PX
    if poor and not layout.on_board:
        _refuse_rearranged(layout)
    return size, _size_warnings(layout, size) + _place_warnings(layout, poor)


def _wrong_size(layout: MarkerLayout, size: SizeFit) -> StrandcastError:
    given_m = float(np.median([marker.size_m for marker in layout.markers]))
    reach_m, right_m = _reach_m(layout.workspace), given_m * size.ratio
    fix = "measure the printed black squares and the distances of their centres; sizes are metres"
    if layout.on_board:
        times = f"{1.0 / size.ratio:.4f} times what it is"
        fix = f"measure both: set marker_m to {right_m:.5f}, or square_m to {times}"
    return layout.error(
        f"the markers measure {right_m * 1e3:.4g} mm relative to their distances, "
        f"{size.ratio - 1.0:+.1%} from the given size ({given_m * 1e3:g} mm){_unit_hint(size.ratio)}",
        f"if the {'squares' if layout.on_board else 'positions'} are wrong, "
        f"{abs(1.0 / size.ratio - 1.0) * reach_m * 1e3:.0f} mm at "
        f"{reach_m:.2f} m from the centre; if only the size is wrong, little",
        fix,
        of_size=True,
    )


def _reach_m(workspace: PlaneBox) -> float:
    """Return half the diagonal of the workspace."""
    return 0.5 * float(np.hypot(*np.ptp(np.array(workspace), axis=1)))


def _unit_hint(ratio: float) -> str:
    """Return a likely cause of a wrong size."""
    guesses = {
        1e-3: "was the size given in millimetres?",
        1e-2: "was the size given in centimetres?",
        1e2: "were the positions given in centimetres?",
        1e3: "were the positions given in millimetres?",
    }
    near = [words for factor, words in guesses.items() if abs(np.log(ratio / factor)) < 0.2]
    if not near and 0.85 < ratio < 0.99:
        near = ["printed with “fit to page”?"]
    return f"; {near[0]}" if near else ""


def _size_warnings(layout: MarkerLayout, size: SizeFit) -> list[str]:
    """Return a warning for a slightly wrong size, with the error if the positions are wrong by as much."""
    off = abs(size.ratio - 1.0)
    if size.rms_px > POOR_PX or off < max(SIZE_WARNING, SIGNIFICANT * size.error):
        return []
    return [
        f"the markers' size fits their distances with {size.ratio - 1.0:+.2%} ± {size.error:.2%}: up to "
        f"{off * _reach_m(layout.workspace) * 1e3:.1f} mm at the string if the positions are wrong"
    ]


def _place_warnings(layout: MarkerLayout, poor: bool) -> list[str]:
    """Return a warning about the marker without which the others fit, or refuse it."""
    fit = layout.fit
    if len(layout.markers) < 3:
        return _does_not_fit(layout) if poor else []
    without = [_fit_without(layout, out) for out in range(len(layout.markers))]
    best = int(np.argmin([each.rms_px for each in without]))
    cost_m = layout.cost_m(without[best])
    if without[best].rms_px < 0.5 * fit.rms_px and cost_m > WARNING_M:
        found = layout, best, without[best], cost_m
        return _of_other_size(*found) or _misplaced(*found)
    return _does_not_fit(layout) if poor else []


def _fit_without(layout: MarkerLayout, out: int) -> PoseFit:
    world_m, corners_px = (np.delete(each, out, axis=0) for each in (layout.fit.world_m, layout.corners_px))
    return fit_pose(world_m, corners_px, layout.camera.lens)


def _of_other_size(layout: MarkerLayout, out: int, others: PoseFit, cost_m: float) -> list[str]:
    """Return a warning about a marker that has another size in the others' pose, or refuse it."""
    marker, camera = layout.markers[out], posed(layout.camera, others)
    corners_m = pixel_to_metre(camera, layout.corners_px[out])
    side_m = float(np.linalg.norm(np.roll(corners_m, -1, axis=0) - corners_m, axis=1).mean())
    ratio = side_m / marker.size_m
    sigma = others.corner_sigma_px() * camera.scale_m_per_px / side_m
    if abs(ratio - 1.0) < max(ONE_SIZE_ERROR, 2.0 * SIGNIFICANT * sigma):
        return []
    eye_m = float(-(others.rotation.T @ others.shift_m)[2])
    nearer_m = eye_m * (1.0 - 1.0 / ratio)
    return _weighed(
        layout,
        f"marker {marker.marker} measures {side_m * 1e3:.1f} mm relative to the others, "
        f"{ratio - 1.0:+.1%} from the given size: another print, less than a cell of white around it, or it "
        f"is {abs(nearer_m) * 1e3:.0f} mm "
        f"{'in front of' if nearer_m > 0 else 'behind'} their plane",
        cost_m,
        "put all markers in one plane, printed at one size",
        of_size=True,
    )


def _misplaced(layout: MarkerLayout, out: int, others: PoseFit, cost_m: float) -> list[str]:
    marker = layout.markers[out]
    x_m, y_m = pixel_to_metre(posed(layout.camera, others), layout.corners_px[out]).mean(axis=0)
    off_m = float(np.hypot(x_m - marker.x_m, y_m - marker.y_m))
    return _weighed(
        layout,
        f"marker {marker.marker} is at ({x_m:.4f}, {y_m:.4f}) m relative to the others, "
        f"{off_m * 1e3:.1f} mm from the given position",
        cost_m,
        "correct its position or rotation in the experiment",
    )


def _does_not_fit(layout: MarkerLayout) -> list[str]:
    square = (layout.fit.residuals_px**2).sum(axis=(1, 2))
    worst = layout.markers[int(np.argmax(square))].marker
    rms_px = layout.fit.rms_px
    measure = "measure the markers' positions and rotations again"
    return _weighed(
        layout,
        f"the markers fit their positions with a residual of {rms_px:.1f} px rms, marker {worst} worst",
        rms_px * layout.camera.scale_m_per_px,
        f"{'flatten the board' if layout.on_board else measure}; is the lens this camera's?",
    )


def _weighed(layout: MarkerLayout, what: str, cost_m: float, fix: str, *, of_size: bool = False) -> list[str]:
    """Return a warning, or refuse the markers if it costs too much."""
    cost = f"about {_millimetres(cost_m)} at the string"
    if cost_m < ERROR_M:
        return [f"{what}: {cost}; {fix}"]
    raise layout.error(what, cost, fix, of_size=of_size)


def _millimetres(cost_m: float) -> str:
    return f"{min(cost_m, 1.0) * 1e3:.1f} mm{' and more' * (cost_m > 1.0)}"


def _refuse_rearranged(layout: MarkerLayout) -> None:
    """Refuse the layout if another arrangement of the same markers fits: swapped, rotated, upside down."""
    trials = []
    for words, markers in _arrangements(layout.markers):
        world_m = np.array([marker.corners_m() for marker in markers])
        trials.append((words, fit_pose(world_m, layout.corners_px, layout.camera.lens)))
    words, fit = min(trials, key=lambda trial: trial[1].rms_px)
    if fit.rms_px > EXPLAINED * layout.fit.rms_px:
        return
    raise layout.error(
        f"{words}: then the corners fit with {fit.rms_px:.2f} px rms, as given with {layout.fit.rms_px:.1f}",
        f"up to {_millimetres(layout.cost_m(fit))} at the string",
        "correct the positions in the experiment, or the markers in the plane",
    )


def _arrangements(markers: list[PlacedMarker]) -> Iterator[tuple[str, list[PlacedMarker]]]:
    """Yield common mistakes in arranging markers, with their descriptions."""
    for i, j in combinations(range(len(markers)), 2):
        swapped = list(markers)
        swapped[i] = replace(markers[j], marker=markers[i].marker)
        swapped[j] = replace(markers[i], marker=markers[j].marker)
        yield f"markers {markers[i].marker} and {markers[j].marker} are swapped", swapped
    for i, marker in enumerate(markers):
        for quarter in (1, 2, 3):
            turned = list(markers)
            turned[i] = replace(marker, angle_rad=marker.angle_rad + quarter * np.pi / 2.0)
            yield f"marker {marker.marker} is rotated by {90 * quarter} degrees", turned
    upside = [replace(m, y_m=-m.y_m, angle_rad=-m.angle_rad) for m in markers]
    yield "y was counted downwards (it is up in the world frame)", upside
    exchanged = [replace(m, x_m=m.y_m, y_m=m.x_m) for m in markers]
    yield "x and y are exchanged", exchanged
    for quarter in (1, 2, 3):
        all_turned = [replace(m, angle_rad=m.angle_rad + quarter * np.pi / 2.0) for m in markers]
        yield f"all markers are rotated by {90 * quarter} degrees", all_turned
