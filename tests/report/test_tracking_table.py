"""The trial's page lists what the tracker detected on the string and at the target."""

from types import SimpleNamespace

from strandcast.records.track import Contact, DetectedSection, DetectedTarget, DetectedWeight
from strandcast.report.panels.tracking import detected_table


def test_weights_pipes_target_and_contact_are_listed():
    summary = SimpleNamespace(
        weights=[DetectedWeight(place_m=0.1496, sigma_m=0.0009, half_width_m=0.0103)],
        sections=[
            DetectedSection(from_m=0.40, from_sigma_m=0.002, to_m=0.50, to_sigma_m=0.002, width_m=0.006),
        ],
        target=DetectedTarget(
            place_m=[0.5, 0.51], sigma_m=0.0003, offset_m=[-0.00002, 0.01], radius_m=0.01, kind="round"
        ),
        contact=Contact(frame=283, camera_time_s=0.566, distance_m=0.007, evidence=["outlines"]),
    )
    text = " ".join(" ".join(row) for row in detected_table(summary).rows)
    for expected in (
        "149.6 ± 0.9 mm",
        "20.6 mm wide",
        "400 ± 2 to 500 ± 2 mm",
        "+0.0 mm in x, +10.0 mm in y",
        "frame 283",
    ):
        assert expected in text


def test_a_bare_string_says_so():
    bare = SimpleNamespace(weights=[], sections=[], target=None, contact=None)
    assert detected_table(bare).rows == []
    assert "Nothing" in detected_table(bare).caption
