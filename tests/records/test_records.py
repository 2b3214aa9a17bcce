"""Every record survives a round trip, and damage or a foreign file gives one clear error."""

import json
from pathlib import Path
from typing import Literal, get_args, get_origin

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from strandcast.errors import StrandcastError
from strandcast.records.alignment import Alignment
from strandcast.records.camera import Camera
from strandcast.records.estimate import Estimate
from strandcast.records.joint_log import Run
from strandcast.records.manifest import Manifest
from strandcast.records.motion import UNITS, Motion, TrajectoryPoint
from strandcast.records.record import Part, Record, content_of
from strandcast.records.summary import ExperimentSummary
from strandcast.records.track import TrackSummary
from strandcast.records.verdict import Verdict

RECORDS = [Alignment, Camera, Estimate, Manifest, Motion, Run, ExperimentSummary, TrackSummary, Verdict]
TEXT = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), max_size=12)
PLAIN = {
    int: st.integers(-(2**53), 2**53),
    float: st.floats(allow_nan=False, allow_infinity=False),
    str: TEXT,
    bool: st.booleans(),
    type(None): st.none(),
}


PAIR = st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=2)
POINTS = st.builds(
    lambda sec, nanosec, *numbers: TrajectoryPoint(
        time_from_start={"sec": sec, "nanosec": nanosec},
        **dict(zip(("positions", "velocities", "accelerations"), numbers, strict=True)),
    ),
    st.integers(0, 9),
    st.integers(0, 10**9 - 1),
    PAIR,
    PAIR,
    PAIR,
)


def values(annotation):
    """Return a strategy for anything that a record's field may hold."""
    if annotation in PLAIN:
        return PLAIN[annotation]
    if isinstance(annotation, type) and issubclass(annotation, Part):
        return parts(annotation)
    if get_origin(annotation) is Literal:
        return st.sampled_from(get_args(annotation))
    arguments = [values(a) for a in get_args(annotation)]
    if get_origin(annotation) is list:
        return st.lists(arguments[0], max_size=3)
    if get_origin(annotation) is dict:
        return st.dictionaries(*arguments, max_size=3)
    return st.one_of(arguments)


def parts(kind):
    fields = {name: values(field.annotation) for name, field in kind.model_fields.items()}
    if kind is Motion:  # its points must be a trajectory of its joints
        fields |= {
            "joint_names": st.just(["a", "b"]),
            "units": st.just(UNITS),
            "points": st.lists(POINTS, min_size=2, max_size=3),
        }
    return st.builds(lambda **given: kind.model_validate(given), **fields)


def any_record():
    return st.sampled_from(RECORDS).flatmap(parts)


@given(record=any_record())
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
def test_round_trip(tmp_path_factory, record: Record):
    path = tmp_path_factory.mktemp("records") / "record.json"
    record.write(path)
    again = type(record).read(path)
    assert again == record
    first = path.read_bytes()
    again.write(path)
    assert path.read_bytes() == first


@pytest.fixture
def verdict(tmp_path) -> Path:
    path = tmp_path / "verdict.json"
    Verdict(
        experiment="e",
        trial=1,
        target_m=[0.5, 0.5],
        hit_radius_m=0.02,
        miss_m=0.003,
        miss_sigma_m=1e-3,
        hit=True,
        closest_frame=7,
        closest_robot_time_s=0.4,
        closest_m=[0.5, 0.503],
        reason=None,
    ).write(path)
    return path


@pytest.mark.parametrize(
    ("damage", "code"),
    [
        (lambda p: p.unlink(), "SC-R001"),
        (lambda p: p.write_text(""), "SC-R001"),
        (lambda p: p.write_text("[1, 2]"), "SC-R001"),
        (lambda p: p.write_bytes(p.read_bytes()[:-9]), "SC-R001"),
        (lambda p: p.write_text(p.read_text().replace("0.003", "NaN")), "SC-R001"),
        (lambda p: p.write_text(p.read_text().replace("0.003", "3e999")), "SC-R001"),
        (lambda p: p.write_text(p.read_text().replace("strandcast/verdict", "other/thing")), "SC-R002"),
        (lambda p: p.write_text(p.read_text().replace('"version": 1', '"version": 9')), "SC-R003"),
        (lambda p: p.write_text(p.read_text().replace("0.003", "0.002")), "SC-R001"),
    ],
)
def test_damage_is_named(verdict, damage, code):
    damage(verdict)
    with pytest.raises(StrandcastError) as caught:
        Verdict.read(verdict)
    assert caught.value.code == code
    assert str(verdict) in str(caught.value)


def test_unknown_keys_are_kept_and_hashed(verdict):
    data = json.loads(verdict.read_text())
    data["operator"] = "K. T."
    verdict.write_text(json.dumps(data))
    with pytest.raises(StrandcastError, match="content_sha256"):
        Verdict.read(verdict)
    extended = Verdict.model_validate(content_of(data))
    extended.write(verdict)
    assert Verdict.read(verdict).content()["operator"] == "K. T."
