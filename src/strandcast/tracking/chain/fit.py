"""The string in one frame: profiles across the chain, the fit of the chain to them, the tip, and a score."""

from typing import NamedTuple

import numpy as np
from numba import njit

from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.bead_search import Beads, behind_bead, is_tip_given, pin_beads
from strandcast.tracking.chain.constraints import NO_TIP, Anchors, Constraints, Pins, Stiffness
from strandcast.tracking.chain.links import link_directions, nodes_along, normals_to, place_nodes, place_on
from strandcast.tracking.chain.profiles import best_path, blank_hand, line_centre, rewards_near, score_across
from strandcast.tracking.chain.search_window import SearchWindow, hidden_nodes
from strandcast.tracking.chain.smoother import Recursion, fit_headings, node_covariances
from strandcast.tracking.chain.tip import END_PX, ends_at_tip, locate_tip

# All chosen on the drawn and lab videos of the tracking benchmark.
DETECTION_PX = 0.45  # standard deviation of a detection across a clear line
CLEAR = 0.25  # reward below which a detection is not used
STIFFNESS = Stiffness(change=0.2, bend=1.0, hidden=0.2, prior=0.8, clamp=2.0, root_m=0.0025)
PATH_STIFFNESS = 0.012  # of the path across profiles, in clear lines per sample²
WIDE_PX, NARROW_PX = 14.0, 6.0  # how far from the prediction the string is searched, first and then
MOVED_PX = 0.7  # change of the chain in one round, from which another round is worth it
ROUNDS = 3  # at most, after the first
BEND_COST = 0.03  # in mean reward, per squared radian of bend, summed over the joints
LEAST_OPEN = 0.25  # share of the chain that the hand must not hide, for a score
END_COST = 0.15  # in mean reward, for a chain whose end is not the string's


class ChainModel(NamedTuple):
    """The string as the chain is fitted to it: length of a link, appearance, beads."""

    link_m: float
    appearance: Appearance
    beads: Beads


class PredictedChain(NamedTuple):
    """The string expected in one frame."""

    clamp_m: np.ndarray  # where it leaves the clamp, (2,)
    start: np.ndarray  # headings (M,) to start from
    prior: np.ndarray  # expected headings (M,)
    half_px: np.ndarray  # half the visible width at each node, blur included, (M + 1,)
    bead_m: np.ndarray  # where the beads are expected, (B, 2); NaN where the chain gives their place


class FrameFit(NamedTuple):
    """The string in one frame."""

    root: np.ndarray  # where the chain starts (m), (2,)
    heading: np.ndarray  # of its links, (M,)
    link_m: float
    reward: np.ndarray  # of each node, 0 not visible ... 1 clear, (M + 1,)
    covariances: np.ndarray  # of the nodes, as estimated by the fit (m²), (M + 1, 2, 2)
    tip_slide_m: float  # from the chain's tip to the string's visible end; NaN if that was not found
    value: float  # mean reward of the nodes that can be visible, minus costs
    open_share: float  # share of the chain that can be visible
    end_is_off: bool  # the tip should be visible but is not where the string ends
    bead_found: bool  # at the tip
    doubled: int  # visible nodes along an earlier part of the chain: it may be folded onto itself

    def nodes(self) -> np.ndarray:
        """Return the chain's nodes (M + 1, 2) (m)."""
        return np.asarray(place_nodes(self.root, self.heading, self.link_m))


class ChainFit(NamedTuple):
    """A chain fitted to profiles."""

    root: np.ndarray  # (2,)
    heading: np.ndarray  # (M,)
    along: np.ndarray  # directions of the links, (M, 2)
    nodes: np.ndarray  # (M + 1, 2)
    recursion: Recursion  # for the nodes' covariances
    reward: np.ndarray  # of the nodes, (M + 1,)


@njit(cache=True, nogil=True)
def fit_frame(
    window: SearchWindow, string: ChainModel, expected: PredictedChain, reach_px: float, hold_tip: bool
) -> FrameFit:
    """Fit the chain to one frame.

    The string is first searched within `reach_px` of `expected.start`. With `hold_tip`, its visible end holds
    the chain's tip.
    """
    appearance, scale = string.appearance, window.plane.metre_per_pixel
    chain, (tip, pins) = fit_in_rounds(window, string, expected, reach_px, hold_tip)
    nodes = chain.nodes
    hidden = hidden_nodes(window, nodes, normals_to(chain.along), expected.half_px, appearance)
    hidden &= chain.reward < CLEAR
    slide_m = tip.along_m if tip.weight > 0 else np.nan
    tip_pinned = len(pins.place_m) > 0 and pins.place_m[-1] == string.beads.place_m[-1]
    bead_found = np.isfinite(appearance.bead_level) and tip_pinned
    if bead_found:
        off = pins.point_m[-1] - place_on(nodes, chain.heading, pins.place_m[-1])
        slide_m = np.cos(chain.heading[-1]) * off[0] + np.sin(chain.heading[-1]) * off[1]
    tip_given = is_tip_given(string.beads, string.link_m * len(chain.heading), expected.bead_m)
    if tip_given:
        off = pins.point_m[np.argmax(pins.place_m)] - nodes[-1]
        slide_m = np.cos(chain.heading[-1]) * off[0] + np.sin(chain.heading[-1]) * off[1]
    slid = not abs(slide_m) < END_PX * scale
    end_is_off = (
        hold_tip
        and not hidden[-1]
        and not tip_given
        and (slid or not ends_at_tip(window, nodes, chain.heading, appearance))
    )
    for k in range(len(hidden)):
        hidden[k] |= behind_bead(k * string.link_m, string.beads)
    hidden[0] = True
    once = counted_once(nodes, chain.heading, 2.5 * scale)
    value, open_share, doubled = mean_reward(chain.reward, hidden, once)
    bends = chain.heading[1:] - chain.heading[:-1]
    value -= END_COST * end_is_off + BEND_COST * (bends * bends).sum()
    return FrameFit(
        chain.root,
        chain.heading,
        string.link_m,
        chain.reward,
        node_covariances(chain.heading, string.link_m, chain.recursion),
        slide_m,
        value,
        open_share,
        end_is_off,
        bead_found,
        doubled,
    )


@njit(cache=True, inline="always")
def fit_in_rounds(
    window: SearchWindow, string: ChainModel, expected: PredictedChain, reach_px: float, hold_tip: bool
) -> tuple[ChainFit, Anchors]:
    """Return the chain after rounds of profiles and fits, and its anchors."""
    link_m, scale = string.link_m, window.plane.metre_per_pixel
    anchors = Anchors(NO_TIP, Pins(np.zeros(0), np.zeros((0, 2)), np.zeros(0)))
    root, heading = expected.clamp_m, expected.start
    along = link_directions(heading)
    nodes = nodes_along(root, along, link_m)
    turn = 0
    # One call of `sample_and_fit`, which is compiled into every place that calls it. `chain` is bound on all
    # paths, as numba requires from Python 3.12 on.
    while True:
        chain = sample_and_fit(window, string, expected, root, heading, along, nodes, reach_px, anchors)
        off_m = chain.nodes - nodes
        moved_m = np.sqrt((off_m[:, 0] ** 2 + off_m[:, 1] ** 2).max())
        root, heading, along, nodes = chain.root, chain.heading, chain.along, chain.nodes
        if turn == ROUNDS:
            break
        turn, reach_px = turn + 1, NARROW_PX
        if hold_tip:
            tip, pins = anchors.tip, pin_beads(window, nodes, heading, string.beads, expected.bead_m)
            tip_given = is_tip_given(string.beads, link_m * len(heading), expected.bead_m)
            if not np.isfinite(string.appearance.bead_level) and not tip_given:
                tip = locate_tip(window, nodes, heading, string.appearance)
            anchors = Anchors(tip, pins)
        if turn > 1 and moved_m < MOVED_PX * scale:
            break
    return chain, anchors


@njit(cache=True, inline="always")
def nearest_turn(angle_rad: float, reference_rad: float) -> float:
    """Return `angle_rad` plus the whole turns that bring it closest to `reference_rad`."""
    return float(angle_rad + 2 * np.pi * np.round((reference_rad - angle_rad) / (2 * np.pi)))


@njit(cache=True, inline="always")
def sample_and_fit(
    window: SearchWindow,
    string: ChainModel,
    expected: PredictedChain,
    root: np.ndarray,
    heading: np.ndarray,
    along: np.ndarray,
    nodes: np.ndarray,
    reach_px: float,
    anchors: Anchors,
) -> ChainFit:
    """Take profiles across a chain, and fit it to them.

    The chain is given by start (2,) and headings (M,), and by what follows from them: the directions of its
    links (M, 2) and its nodes (M + 1, 2).
    """
    link_m, scale = string.link_m, window.plane.metre_per_pixel
    lines = score_across(window, nodes, normals_to(along), expected.half_px, string.appearance, reach_px)
    blank_hand(lines, window.hand_box)
    path = best_path(lines.score, PATH_STIFFNESS, max(1, int(0.8 * link_m / lines.pitch_m)))
    centre = line_centre(lines.score, path, lines.line_half)
    count = len(nodes)
    target = nodes.copy()
    weight = np.zeros(count)
    for k in range(1, count):
        reward = min(max(lines.score[k, path[k]], 0.0), 1.0)
        across = (centre[k] - lines.half) * lines.pitch_m
        target[k, 0] += across * lines.normals[k, 0]
        target[k, 1] += across * lines.normals[k, 1]
        if reward >= CLEAR and not behind_bead(k * link_m, string.beads):
            sigma = DETECTION_PX * scale * (1.0 + 0.3 * expected.half_px[k])
            weight[k] = (reward / sigma) ** 2
    clamp_rad = nearest_turn(window.hand_box.angle_rad, heading[0])
    known = Constraints(
        target, lines.normals, weight, anchors, expected.prior, expected.clamp_m, clamp_rad, STIFFNESS
    )
    root, heading, recursion = fit_headings(root, heading, link_m, known, 2)
    along = link_directions(heading)
    nodes = nodes_along(root, along, link_m)
    return ChainFit(root, heading, along, nodes, recursion, rewards_near(lines, nodes))


@njit(cache=True)
def mean_reward(reward: np.ndarray, hidden: np.ndarray, once: np.ndarray) -> tuple[float, float, int]:
    """Return the mean reward of nodes (K,) that can be visible, their share, and how many are doubled."""
    total, count, doubled = 0.0, 0, 0
    for k in range(len(reward)):
        if not hidden[k]:
            total += reward[k] * once[k]
            count += 1
            doubled += once[k] == 0.0
    open_share = count / len(reward)
    value = total / count if open_share > LEAST_OPEN else 0.0
    return value, open_share, doubled


@njit(cache=True)
def counted_once(nodes: np.ndarray, heading: np.ndarray, near_m: float) -> np.ndarray:
    """Return 0 for nodes that lie along an earlier part of the chain, 1 for others (K,).

    Otherwise a chain folded back onto itself would count the same piece of string twice.
    """
    once = np.ones(len(nodes))
    for k in range(6, len(nodes)):
        for j in range(1, k - 4):
            close = (nodes[k, 0] - nodes[j, 0]) ** 2 + (nodes[k, 1] - nodes[j, 1]) ** 2 < near_m * near_m
            if close and abs(np.sin(heading[k - 1] - heading[j - 1])) < 0.4:
                once[k] = 0.0
                break
    return once
