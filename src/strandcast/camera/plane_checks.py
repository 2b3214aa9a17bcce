"""What is wrong with the plane's markers: size, swapped, turned, misplaced; and what it costs at the string.

What costs more than 2 mm somewhere in the workspace is an error; less is told, from 0.3 mm on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from strandcast.camera.mapping import pixel_to_metre
from strandcast.camera.plane_error import Box, worst_difference_m
from strandcast.camera.pose import PlaneMarker, PoseFit, SizeFit, fit_pose, fit_size, posed
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera

ERROR_M, WARNING_M = 2e-3, 3e-4
SURE = 4.0  # standard errors
POOR_PX = 1.0  # rms of a fit for which a reason is looked for
SIZE_ERROR, SIZE_WARNING = 0.02, 0.005
ONE_SIZE_ERROR = 0.03
EXPLAINED = 0.35  # of the rms, that a reason must leave at most
PRINTED = "measure the printed black squares and the distances of their centres; sizes are metres"


@dataclass(frozen=True)
class Layout:
    """The markers that were seen, as the experiment places them, and their corners (K, 4, 2) [px]."""

    markers: list[PlaneMarker]
    corners_px: np.ndarray
    camera: Camera
    fit: PoseFit
    box: Box
    file: str | None

    def cost_m(self, other: PoseFit) -> float:
        """Return by how much the string would be off, at the worst place, were another pose the true one."""
        return worst_difference_m(posed(self.camera, other), self.camera, self.box)


def check_markers(layout: Layout) -> tuple[SizeFit, list[str]]:
    """Hold the markers against their size and places.

    Returns
    -------
    size
        As the markers' distances tell it.
    warnings
        What is a little off, with what it costs.

    Raises
    ------
    StrandcastError
        SC-C026 size or distances are wrong by more than 2 %, or one marker is of another size or out of the
        plane; SC-C027 one lies elsewhere, or no single reason explains it; SC-C028 two are swapped, one is
        turned, or the axes are not those of the world.
    """
    size = fit_size(layout.markers, layout.corners_px, layout.camera.lens)
    by_size = size.rms_px < POOR_PX
    if by_size and abs(size.ratio - 1.0) > max(SIZE_ERROR, SURE * size.error):
        raise _wrong_size(layout, size)
    poor = layout.fit.rms_px > POOR_PX
    if poor:
        _refuse_rearranged(layout)
    return size, _size_warnings(layout, size) + _place_warnings(layout, poor)


def _wrong_size(layout: Layout, size: SizeFit) -> StrandcastError:
    given_m = float(np.median([marker.size_m for marker in layout.markers]))
    reach_m = _reach_m(layout.box)
    return StrandcastError(
        "SC-C026",
        f"the markers measure {given_m * size.ratio * 1e3:.4g} mm against each other's places, "
        f"{size.ratio - 1.0:+.1%} from the size given ({given_m * 1e3:g} mm){_unit_words(size.ratio)}",
        file=layout.file,
        field="camera.plane.size_m",
        cost=f"if the places are wrong, {abs(1.0 / size.ratio - 1.0) * reach_m * 1e3:.0f} mm at "
        f"{reach_m:.2f} m from the middle; if the size is, little",
        fix=PRINTED,
    )


def _reach_m(box: Box) -> float:
    """Return the half diagonal of a box."""
    return 0.5 * float(np.hypot(*np.ptp(np.array(box), axis=1)))


def _unit_words(ratio: float) -> str:
    """Guess what a wrong size comes from."""
    guesses = {
        1e-3: "was the size given in millimetres?",
        1e-2: "was the size given in centimetres?",
        1e2: "were the places given in centimetres?",
        1e3: "were the places given in millimetres?",
    }
    near = [words for factor, words in guesses.items() if abs(np.log(ratio / factor)) < 0.2]
    if not near and 0.85 < ratio < 0.99:
        near = ["printed with “fit to page”?"]
    return f"; {near[0]}" if near else ""


def _size_warnings(layout: Layout, size: SizeFit) -> list[str]:
    """Tell of a size that is a little off, and what it costs where the places are wrong by as much."""
    off = abs(size.ratio - 1.0)
    if size.rms_px > POOR_PX or off < max(SIZE_WARNING, SURE * size.error):
        return []
    return [
        f"the markers' size fits their distances with {size.ratio - 1.0:+.2%} ± {size.error:.2%}: up to "
        f"{off * _reach_m(layout.box) * 1e3:.1f} mm at the string if the places are wrong"
    ]


def _place_warnings(layout: Layout, poor: bool) -> list[str]:
    """Name the marker without which the others fit, and what it costs; or refuse."""
    fit = layout.fit
    if len(layout.markers) < 3:
        if poor:
            raise _does_not_fit(layout)
        return []
    without = [_fit_without(layout, out) for out in range(len(layout.markers))]
    best = int(np.argmin([each.rms_px for each in without]))
    cost_m = layout.cost_m(without[best])
    if without[best].rms_px < 0.5 * fit.rms_px and cost_m > WARNING_M:
        _refuse_other_size(layout, best, without[best], cost_m)
        return _misplaced(layout, best, without[best], cost_m)
    if poor:
        raise _does_not_fit(layout)
    return []


def _fit_without(layout: Layout, out: int) -> PoseFit:
    world_m, corners_px = (np.delete(each, out, axis=0) for each in (layout.fit.world_m, layout.corners_px))
    return fit_pose(world_m, corners_px, layout.camera.lens)


def _refuse_other_size(layout: Layout, out: int, others: PoseFit, cost_m: float) -> None:
    """Refuse a marker that the others' pose sees larger or smaller than it is said to be."""
    marker, camera = layout.markers[out], posed(layout.camera, others)
    corners_m = pixel_to_metre(camera, layout.corners_px[out])
    side_m = float(np.linalg.norm(np.roll(corners_m, -1, axis=0) - corners_m, axis=1).mean())
    ratio = side_m / marker.size_m
    sigma = others.corner_sigma_px() * camera.scale_m_per_px / side_m
    if abs(ratio - 1.0) < max(ONE_SIZE_ERROR, 2.0 * SURE * sigma):
        return
    eye_m = float(-(others.rotation.T @ others.shift_m)[2])
    nearer_m = eye_m * (1.0 - 1.0 / ratio)
    raise StrandcastError(
        "SC-C026",
        f"marker {marker.marker} measures {side_m * 1e3:.1f} mm by the others, {ratio - 1.0:+.1%} from the "
        f"size given: another print, or it lies {abs(nearer_m) * 1e3:.0f} mm "
        f"{'before' if nearer_m > 0 else 'behind'} their plane",
        file=layout.file,
        field="camera.plane.size_m",
        cost=f"up to {cost_m * 1e3:.1f} mm at the string",
        fix="lay all markers into one plane, printed at one size",
    )


def _fit_of(layout: Layout, markers: Sequence[PlaneMarker]) -> PoseFit:
    world_m = np.array([marker.corners_m() for marker in markers])
    return fit_pose(world_m, layout.corners_px, layout.camera.lens)


def _misplaced(layout: Layout, out: int, others: PoseFit, cost_m: float) -> list[str]:
    marker = layout.markers[out]
    seen = pixel_to_metre(posed(layout.camera, others), layout.corners_px[out]).mean(axis=0)
    off_m = float(np.hypot(seen[0] - marker.x_m, seen[1] - marker.y_m))
    what = (
        f"marker {marker.marker} lies at ({seen[0]:.4f}, {seen[1]:.4f}) m by the others, "
        f"{off_m * 1e3:.1f} mm from the place given"
    )
    if cost_m < ERROR_M and off_m < 2.0 * ERROR_M:
        return [f"{what}: up to {cost_m * 1e3:.1f} mm at the string"]
    raise StrandcastError(
        "SC-C027",
        what,
        file=layout.file,
        field="camera.plane.markers",
        cost=f"up to {cost_m * 1e3:.1f} mm at the string",
        fix="correct its place or turn in the experiment",
    )


def _does_not_fit(layout: Layout) -> StrandcastError:
    square = (layout.fit.residuals_px**2).sum(axis=(1, 2))
    worst = layout.markers[int(np.argmax(square))].marker
    rms_px = layout.fit.rms_px
    return StrandcastError(
        "SC-C027",
        f"the markers fit their places with {rms_px:.1f} px rms only, marker {worst} worst",
        file=layout.file,
        field="camera.plane.markers",
        cost=f"some {rms_px * layout.camera.scale_m_per_px * 1e3:.1f} mm at the string",
        fix="measure the markers' places and turns again; is the lens this camera's?",
    )


def _refuse_rearranged(layout: Layout) -> None:
    """Raise where another arrangement of the same markers fits: swapped, turned, upside down."""
    trials = [(words, _fit_of(layout, markers)) for words, markers in _arrangements(layout.markers)]
    words, fit = min(trials, key=lambda trial: trial[1].rms_px)
    if fit.rms_px > EXPLAINED * layout.fit.rms_px:
        return
    raise StrandcastError(
        "SC-C028",
        f"{words}: so the corners fit with {fit.rms_px:.2f} px rms, as given with {layout.fit.rms_px:.1f}",
        file=layout.file,
        field="camera.plane.markers",
        cost=f"up to {layout.cost_m(fit) * 1e3:.0f} mm at the string",
        fix="correct the places in the experiment, or the markers in the plane",
    )


def _arrangements(markers: list[PlaneMarker]) -> Iterator[tuple[str, list[PlaneMarker]]]:
    """Yield arrangements that people lay instead of the one they mean."""
    for i, j in combinations(range(len(markers)), 2):
        swapped = list(markers)
        swapped[i] = replace(markers[j], marker=markers[i].marker)
        swapped[j] = replace(markers[i], marker=markers[j].marker)
        yield f"markers {markers[i].marker} and {markers[j].marker} are swapped", swapped
    for i, marker in enumerate(markers):
        for quarter in (1, 2, 3):
            turned = list(markers)
            turned[i] = replace(marker, angle_rad=marker.angle_rad + quarter * np.pi / 2.0)
            yield f"marker {marker.marker} is turned by {90 * quarter} degrees", turned
    upside = [replace(m, y_m=-m.y_m, angle_rad=-m.angle_rad) for m in markers]
    yield "y was counted downwards (it is up in the world frame)", upside
    exchanged = [replace(m, x_m=m.y_m, y_m=m.x_m) for m in markers]
    yield "x and y are exchanged", exchanged
    for quarter in (1, 2, 3):
        all_turned = [replace(m, angle_rad=m.angle_rad + quarter * np.pi / 2.0) for m in markers]
        yield f"all markers are turned by {90 * quarter} degrees", all_turned
