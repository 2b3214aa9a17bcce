"""Real pictures of a cable that crosses itself, ordered as labelled by eye."""

import numpy as np
import pytest

from strandcast_studies.evidence import mbest_stills as stills
from strandcast_studies.stills.centreline import StillCrossing, StillString
from strandcast_studies.stills.line import even_line


def through(way_px: np.ndarray, crossings_px: np.ndarray) -> StillString:
    """Return a string along the given places."""
    line = even_line(way_px)[0]
    crossings = [StillCrossing(place, (0.0, 1.0), 99.0, True, True) for place in crossings_px]
    return StillString(line, np.ones(len(line), bool), 12.0, crossings, np.zeros((1, 1), bool), {}, [])


def test_every_picture_is_labelled():
    orders = stills.reference_orders()
    assert len(orders) == 20
    assert sum(len(order.crossings_px) for order in orders.values()) == 39
    assert min(len(order.way_px) for order in orders.values()) >= 10


@pytest.mark.parametrize("name", ["img0", "img30", "img60"])
def test_a_wrong_order_is_a_fault(name):
    expected = stills.reference_orders()[name]
    assert stills.order_faults(through(expected.way_px, expected.crossings_px), expected) == []
    assert stills.order_faults(through(expected.way_px[::-1], expected.crossings_px), expected) == []
    # A loop in the wrong direction: the places between the two passes of its crossing.
    turned = expected.way_px.copy()
    turned[2:6] = turned[5:1:-1]
    (fault,) = stills.order_faults(through(turned, expected.crossings_px), expected)
    assert "passed at" in fault
    assert stills.order_faults(through(expected.way_px[:-3], expected.crossings_px), expected)
    assert stills.order_faults(through(expected.way_px, expected.crossings_px[:-1]), expected)
    assert stills.order_faults(through(expected.way_px, expected.crossings_px + 40.0), expected)


@pytest.mark.thorough
def test_the_cable_is_ordered_as_labelled_and_lies_on_the_mask(real_data):
    figures = {figure.name: figure for figure in stills.measure(real_data / "mbest_s1")}
    for name in ("orders_wrong", "orders_wrong_from_picture", "outside_mask", "from_medial_axis"):
        figure = figures[f"mbest_s1.{name}"]
        assert figure.met, (figure.value, figure.detail)
    assert figures["mbest_s1.picture_against_mask"].value < 0.5
