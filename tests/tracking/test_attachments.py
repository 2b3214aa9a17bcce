"""Weights and pipes are detected at their places, and nothing is detected on a bare string."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from strandcast.records.track import DetectedSection, DetectedWeight
from strandcast.tracking.attachments.declared_vs_detected import declaration_conflicts
from strandcast.tracking.attachments.detect import Attachments, attachments_from_widths, detect_attachments
from strandcast.tracking.attachments.widths import choose_frames, places_along, widths_along
from strandcast.tracking.chain.search_window import HandBox, SearchWindow
from strandcast.tracking.pixel_map import tabulate

LENGTH_M, LINKS, THICK_PX = 0.36, 72, 2.2
WEIGHT_M, WEIGHT_RADIUS_PX = 0.12, 5.5
PIPE_M, PIPE_PX = (0.20, 0.28), 4.6
WALL, CORD = 90.0, 200.0
GRAIN = np.random.default_rng(5).normal(size=(640, 840)).astype(np.float32)


def chains(scene, frames=32, pipe=None):
    """Nodes (F, LINKS + 1, 2) of a string that whips about; links within `pipe` keep one direction."""
    share = (np.arange(LINKS) + 0.5) / LINKS
    nodes = []
    for f in range(frames):
        ease = f / frames
        wave = 0.9 * np.sin(2 * np.pi * (0.8 * share - 1.6 * ease))
        heading = -np.pi / 2 + 2.0 * (ease - 0.3) + wave
        if pipe is not None:
            inside = (share * LENGTH_M > pipe[0]) & (share * LENGTH_M < pipe[1])
            heading[inside] = heading[inside].mean()
        steps = LENGTH_M / LINKS * np.column_stack([np.cos(heading), np.sin(heading)])
        start = np.array([0.15 * np.cos(2 * ease), 0.12 + 0.1 * ease])
        nodes.append(np.concatenate([start[None], start + np.cumsum(steps, axis=0)]))
    return np.stack(nodes)


def draw(scene, background, nodes, rng, noise, weight=None, pipe=None, blur_px=0.0, bystander=False):
    image = background.copy()
    line = scene.to_pixels(nodes)
    scene.draw_line(image, line, THICK_PX, CORD)
    if pipe is not None:
        first, last = (round(place / LENGTH_M * LINKS) for place in pipe)
        scene.draw_line(image, line[first : last + 1], PIPE_PX, CORD + 10)
    if weight is not None:
        at = line[round(weight / LENGTH_M * LINKS)]
        spot = np.rint(at * 16).astype(int).tolist()
        cv2.circle(image, spot, int(WEIGHT_RADIUS_PX * 16), CORD - 25, -1, cv2.LINE_AA, 4)
    if bystander:
        scene.draw_line(image, np.array([[250.0, 0.0], [420.0, 600.0]]), 30, 40)
    if blur_px:
        image = cv2.GaussianBlur(image, (0, 0), blur_px)
    grain = np.roll(GRAIN, rng.integers(0, 500, 2).tolist(), (0, 1))[: image.shape[0], : image.shape[1]]
    return np.clip(np.rint(image + noise * grain), 0, 255).astype(np.uint8)


def drawn_width_m(scene):
    """Return a drawn line's width: its summed change over that of a covered pixel."""
    image = np.full((scene.HEIGHT, scene.WIDTH), WALL, np.float32)
    scene.draw_line(image, np.array([[400.3, 100.0], [400.3, 500.0]]), THICK_PX, CORD)
    return float((image[200:400] - WALL).sum(axis=1).mean()) / (CORD - WALL) * scene.SCALE_M


def detect(scene, nodes, seed=0, noise=3.0, slide_px=0.0, passes_every=0, **drawn):
    """Return the attachments of the string `nodes`, tracked with an error of about half a pixel."""
    rng = np.random.default_rng(seed)
    rough = cv2.GaussianBlur(rng.normal(0, 1, (scene.HEIGHT, scene.WIDTH)), (0, 0), 9)
    background = (WALL + 12 * rough / rough.std()).astype(np.float32)
    plane = tabulate(scene.flat_camera(), 0.0)
    still = np.clip(np.rint(background), 0, 255).astype(np.uint8)

    def picture(frame):
        passes = passes_every and frame % passes_every == 0
        image = draw(scene, background, nodes[frame], rng, noise, bystander=bool(passes), **drawn)
        return SearchWindow(image, 0, 0, still, plane, HandBox(*np.zeros(7)))

    tracked = nodes + scene.SCALE_M * rng.normal(0, 0.5, (len(nodes), 1, 2))
    return detect_attachments(picture, tracked, np.ones(nodes.shape[:2]), CORD, CORD - WALL)


@pytest.mark.parametrize(("seed", "blur_px"), [(0, 0.6), (1, 1.6)])
def test_a_weight_and_a_pipe_are_detected_at_their_places(scene, seed, blur_px):
    found = detect(scene, chains(scene, pipe=PIPE_M), seed, blur_px=blur_px, weight=WEIGHT_M, pipe=PIPE_M)
    (weight,), (pipe,) = found.weights, found.sections
    assert abs(weight.place_m - WEIGHT_M) < 0.0015
    assert weight.half_width_m == pytest.approx(WEIGHT_RADIUS_PX * scene.SCALE_M, rel=0.2)
    # The pipe is drawn with round ends.
    cap_m = 0.5 * PIPE_PX * scene.SCALE_M
    assert -cap_m - 0.001 < pipe.from_m - PIPE_M[0] < 0.0015
    assert -0.0015 < pipe.to_m - PIPE_M[1] < cap_m + 0.001
    for off, sigma in (
        (weight.place_m - WEIGHT_M, weight.sigma_m),
        (pipe.from_m - PIPE_M[0], pipe.from_sigma_m),
        (pipe.to_m - PIPE_M[1], pipe.to_sigma_m),
    ):
        assert abs(off) < 3 * sigma < 0.012
    assert pipe.stiff is True
    assert pipe.width_m > 1.5 * found.width_m


def test_a_wider_stretch_that_bends_is_no_stiff_pipe(scene):
    (section,) = detect(scene, chains(scene), pipe=PIPE_M).sections
    assert section.stiff is False


def test_a_ball_at_the_tip_is_a_weight_there(scene):
    (weight,) = detect(scene, chains(scene), weight=LENGTH_M).weights
    assert weight.place_m == pytest.approx(LENGTH_M, abs=0.002)


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_detected_on_a_bare_string(scene, seed):
    found = detect(scene, chains(scene), seed, noise=8.0, passes_every=3)
    assert (found.weights, found.sections) == ((), ())
    assert found.width_m == pytest.approx(drawn_width_m(scene), rel=0.1)


def test_an_object_that_passes_in_some_frames_does_not_hide_a_weight(scene):
    (weight,) = detect(scene, chains(scene), passes_every=3, weight=WEIGHT_M).weights
    assert abs(weight.place_m - WEIGHT_M) < 0.002


def test_nothing_is_detected_on_a_string_at_rest(scene):
    nodes = np.repeat(chains(scene, 8)[:1], 40, axis=0)
    found = detect(scene, nodes, weight=WEIGHT_M)
    assert (found.weights, found.frames) == ((), 0)


def test_frames_are_chosen_that_show_the_string_clearly_and_elsewhere(scene):
    nodes = chains(scene, 12)
    quality = np.ones(nodes.shape[:2])
    quality[4] = 0.3
    nodes[7] = np.nan
    nodes[9] = nodes[8]
    assert choose_frames(nodes, quality, scene.SCALE_M).tolist() == [0, 1, 2, 3, 5, 6, 8, 10, 11]


@pytest.mark.parametrize("blur_px", [0.5, 1.5, 3.0])
def test_blur_does_not_widen_the_string(scene, blur_px):
    nodes = chains(scene)[10]
    rng = np.random.default_rng(0)
    background = np.full((scene.HEIGHT, scene.WIDTH), WALL, np.float32)
    image = draw(scene, background, nodes, rng, 0.0, blur_px=blur_px)
    still = np.rint(background).astype(np.uint8)
    picture = SearchWindow(image, 0, 0, still, tabulate(scene.flat_camera(), 0.0), HandBox(*np.zeros(7)))
    places = places_along(LENGTH_M, scene.SCALE_M)
    widths = widths_along(picture, nodes, places, CORD, CORD - WALL)
    middle = widths[(places > 0.03) & (places < LENGTH_M - 0.03)]
    assert np.median(middle) == pytest.approx(drawn_width_m(scene), rel=0.04)


def test_places_about_which_frames_disagree_are_unknown(scene):
    rng = np.random.default_rng(0)
    places = places_along(LENGTH_M, scene.SCALE_M)
    widths = 0.003 + 0.0002 * rng.normal(size=(40, len(places)))
    widths[:, places > LENGTH_M] *= 0.01
    bump = np.abs(places - 0.15) < 0.008
    widths[:20, bump] += 0.012  # a knot that half of the frames do not have
    found = attachments_from_widths(places, widths, LENGTH_M, scene.SCALE_M, chains(scene, 40))
    assert found.weights == ()
    widths[20:, bump] += 0.012
    (weight,) = attachments_from_widths(places, widths, LENGTH_M, scene.SCALE_M, chains(scene, 40)).weights
    assert weight.place_m == pytest.approx(0.15, abs=0.0005)


def plain_widths(places, frames=40):
    """Widths (F, K) of a bare string, with a little noise."""
    widths = 0.003 + 0.0002 * np.random.default_rng(0).normal(size=(frames, len(places)))
    widths[:, places > LENGTH_M] *= 0.01
    return widths


def test_the_hands_shadow_is_not_taken_for_a_weight(scene):
    places = places_along(LENGTH_M, scene.SCALE_M)
    widths = plain_widths(places)
    near = places < 0.035
    widths[:, near] = np.random.default_rng(1).uniform(0.0, 0.03, (40, near.sum()))
    found = attachments_from_widths(places, widths, LENGTH_M, scene.SCALE_M, chains(scene, 40))
    assert found.weights == ()
    assert found.visible_from_m > 0.034


@pytest.mark.parametrize(("more_m", "weights"), [(0.0015, 0), (0.006, 1)])
def test_a_knot_is_no_weight(scene, more_m, weights):
    places = places_along(LENGTH_M, scene.SCALE_M)
    widths = plain_widths(places)
    widths[:, np.abs(places - 0.15) < 0.004] += more_m
    found = attachments_from_widths(places, widths, LENGTH_M, scene.SCALE_M, chains(scene, 40))
    assert len(found.weights) == weights


def attachments(weights=(), sections=()):
    detected = [DetectedWeight(place_m=place, sigma_m=0.0013, half_width_m=0.01) for place in weights]
    return Attachments(tuple(detected), tuple(sections), 0.003, 0.04, 100)


def test_a_declared_weight_detected_elsewhere_is_warned_of():
    (warning,) = declaration_conflicts(attachments([0.19, 0.30]), [0.15, 0.301], [], 0.30)
    assert "declared at 150 mm" in warning
    assert "190 ± 1.3 mm: 40 mm off" in warning


def test_declared_places_that_fit_or_are_not_visible_are_not_warned_of():
    assert declaration_conflicts(attachments([0.296]), [0.31, 0.1], [], 0.30) == []  # at the tip
    assert declaration_conflicts(attachments([0.19]), [], [], 0.30) == []


def test_an_unsure_place_is_no_contradiction():
    detected = attachments([0.165])
    unsure = detected.weights[0].model_copy(update={"sigma_m": 0.005})
    assert len(declaration_conflicts(detected, [0.15], [], 0.30)) == 1
    assert declaration_conflicts(replace(detected, weights=(unsure,)), [0.15], [], 0.30) == []


def test_an_undeclared_weight_is_warned_of():
    (warning,) = declaration_conflicts(attachments([0.15, 0.22]), [0.15], [], 0.30)
    assert "undeclared weight is detected at 220" in warning


def test_a_declared_section_is_compared_with_the_detected_one():
    section = DetectedSection(
        from_m=0.20, from_sigma_m=0.002, to_m=0.28, to_sigma_m=0.002, width_m=0.006, stiff=True
    )
    assert declaration_conflicts(attachments(sections=[section]), [], [(0.205, 0.285)], 0.36) == []
    (warning,) = declaration_conflicts(attachments(sections=[section]), [], [(0.16, 0.28)], 0.36)
    assert "detected from 200 ± 2.0 mm to 280 ± 2.0 mm" in warning
    soft = section.model_copy(update={"stiff": False})
    (warning,) = declaration_conflicts(attachments(sections=[soft]), [], [(0.20, 0.28)], 0.36)
    assert warning.endswith("but it bends")
