"""Joint logs out of real bags: rosbag1, rosbag2 in SQLite and in MCAP, written here by rosbags itself."""

from dataclasses import dataclass

import numpy as np
import pytest

from strandcast.errors import StrandcastError
from strandcast.imports.joints import Played, Reading, import_joints
from strandcast.records.joint_log import read_run

pytest.importorskip("rosbags", reason="rosbags is not installed: make test-drivers")

from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

KINDS = ("rosbag1", "sqlite3", "mcap")
ARM = ["shoulder_lift_joint", "elbow_joint", "wrist_1_joint"]
ALPHABETICAL = ["elbow_joint", "finger", "shoulder_lift_joint", "wrist_1_joint"]
START_NS = 1_700_000_000_123_456_789
JOINT_STATE = "sensor_msgs/msg/JointState"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
SINCE_IRON = """\
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint reference
trajectory_msgs/JointTrajectoryPoint feedback
trajectory_msgs/JointTrajectoryPoint error
trajectory_msgs/JointTrajectoryPoint output
"""
BEFORE_IRON = """\
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
trajectory_msgs/JointTrajectoryPoint error
"""


@dataclass
class Sent:
    """A message: topic, type, its stamp and when it was received [ns], and its other fields."""

    topic: str
    kind: str
    stamp_ns: int
    receive_ns: int
    fields: dict


def typestore(kind, definition=None):
    store = get_typestore(Stores.ROS1_NOETIC if kind == "rosbag1" else Stores.ROS2_HUMBLE)
    if definition:
        store.register(get_types_from_msg(definition, CONTROLLER_STATE))
    return store


def write_bag(tmp_path, kind, sent, definition=None):
    """Write messages as a bag of a kind and return its path."""
    store = typestore(kind, definition)
    types = store.types
    if kind == "rosbag1":
        path, writer = tmp_path / "log.bag", rosbag1.Writer(tmp_path / "log.bag")
    else:
        plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        path, writer = tmp_path / "log", rosbag2.Writer(tmp_path / "log", version=9, storage_plugin=plugin)
    with writer:
        connections = {(s.topic, s.kind): None for s in sent}
        for topic, name in connections:
            connections[topic, name] = writer.add_connection(topic, name, typestore=store)
        for message in sent:
            stamp = types["builtin_interfaces/msg/Time"](*divmod(message.stamp_ns, 10**9))
            head = {"stamp": stamp, "frame_id": ""} | ({"seq": 0} if kind == "rosbag1" else {})
            fields = {"header": types["std_msgs/msg/Header"](**head)} | message.fields
            raw = types[message.kind](**fields)
            blob = (store.serialize_ros1 if kind == "rosbag1" else store.serialize_cdr)(raw, message.kind)
            writer.write(connections[message.topic, message.kind], message.receive_ns, blob)
    return path


def wave(ns, names=ALPHABETICAL):
    """Return the angles and speeds at a time since the start, by a formula of the joint's name."""
    t = ns * 1e-9
    phase = np.array([float(len(name)) for name in names])
    return np.sin(3.0 * t + phase), 3.0 * np.cos(3.0 * t + phase)


def joint_states(
    count=200, topic="/joint_states", names=ALPHABETICAL, late_ns=800_000, stamped=True, speeds=True
):
    sent = []
    for k in range(count):
        ns = 2_000_000 * k
        q, qd = wave(ns, names)
        fields = {"name": list(names), "position": q, "velocity": qd if speeds else np.zeros(0)}
        fields["effort"] = np.zeros(0)
        received = START_NS + ns + late_ns + (400_000 if k % 2 else 0)
        sent.append(Sent(topic, JOINT_STATE, START_NS + ns if stamped else 0, received, fields))
    return sent


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_of_joint_states_is_read_by_names(tmp_path, kind):
    path = write_bag(tmp_path, kind, joint_states())
    run = import_joints(path, tmp_path / "trial", namings=[ARM])
    again, log = read_run(tmp_path / "trial")
    assert again == run
    assert run.driver == "import: bag"
    assert log.joint_names == ARM  # the arm's order, not the alphabet's; no finger
    since_ns = 2_000_000 * np.arange(200)
    np.testing.assert_allclose(log.time_s - START_NS * 1e-9, since_ns * 1e-9, atol=3e-7)
    np.testing.assert_array_equal(log.q_rad, [wave(ns, ARM)[0] for ns in since_ns])
    np.testing.assert_array_equal(log.qd_rad_s, [wave(ns, ARM)[1] for ns in since_ns])
    assert np.isnan(log.q_cmd_rad).all()
    assert run.timing.rate_hz == pytest.approx(500, rel=1e-3)
    assert run.clock.startswith("header stamp (received 1.0 ms later, up to 1.2 ms) of /joint_states")
    assert len(run.controller["sha256"]) == 64


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_the_storage_file_alone_is_enough(tmp_path, suffix):
    folder = write_bag(tmp_path, "mcap" if suffix == ".mcap" else "sqlite3", joint_states())
    (file,) = folder.glob(f"*{suffix}")
    run = import_joints(file, tmp_path / "trial", namings=[ARM])
    assert run.rows == 200


def test_the_time_of_reception_is_used_on_request_or_without_a_stamp(tmp_path):
    path = write_bag(tmp_path, "mcap", joint_states())
    run = import_joints(path, tmp_path / "a", Reading(clock="receive"), [ARM])
    assert run.clock.startswith("time of reception (1.0 ms after the stamp, up to 1.2 ms)")
    assert run.timing.uneven > 90
    assert read_run(tmp_path / "a")[1].time_s[0] == pytest.approx(START_NS * 1e-9 + 0.0008, abs=3e-7)
    (tmp_path / "b").mkdir()
    path = write_bag(tmp_path / "b", "mcap", joint_states(stamped=False))
    run = import_joints(path, tmp_path / "c", namings=[ARM])
    assert run.clock.startswith("time of reception of /joint_states")
    assert "header stamps are zero" in run.warnings[0]


def test_a_bag_with_several_topics_asks_which(tmp_path):
    both = joint_states() + joint_states(topic="/left/joint_states", count=50)
    path = write_bag(tmp_path, "sqlite3", sorted(both, key=lambda message: message.receive_ns))
    with pytest.raises(StrandcastError, match="SC-I042") as refusal:
        import_joints(path, tmp_path / "trial", namings=[ARM])
    assert "/joint_states (JointState); /left/joint_states (JointState)" in refusal.value.what
    assert "--topic" in refusal.value.fix
    assert not (tmp_path / "trial").exists()
    with pytest.raises(StrandcastError, match="/right has no joints"):
        import_joints(path, tmp_path / "trial", Reading(topic="/right"), [ARM])
    assert import_joints(path, tmp_path / "trial", Reading(topic="/left/joint_states"), [ARM]).rows == 50


@pytest.mark.parametrize("definition", [SINCE_IRON, BEFORE_IRON])
@pytest.mark.parametrize("kind", ["rosbag1", "mcap"])
def test_a_controllers_state_includes_the_commands(tmp_path, kind, definition):
    point = typestore(kind).types["trajectory_msgs/msg/JointTrajectoryPoint"]
    duration = typestore(kind).types["builtin_interfaces/msg/Duration"]

    def at(q, qd):
        return point(q, qd, np.zeros(0), np.zeros(0), duration(0, 0))

    sent = []
    for k in range(100):
        ns = 4_000_000 * k
        command, actual = at(*wave(ns, ARM[::-1])), at(*wave(ns - 30_000_000, ARM[::-1]))
        fields = {"joint_names": ARM[::-1], "error": command}
        if definition is SINCE_IRON:
            fields |= {"reference": command, "feedback": actual, "output": command}
        else:
            fields |= {"desired": command, "actual": actual}
        sent.append(Sent("/arm/state", CONTROLLER_STATE, START_NS + ns, START_NS + ns + 1000, fields))
    path = write_bag(tmp_path, kind, sent, definition)
    import_joints(path, tmp_path / "trial", namings=[ARM])
    _, log = read_run(tmp_path / "trial")
    np.testing.assert_array_equal(log.q_cmd_rad, [wave(4_000_000 * k, ARM)[0] for k in range(100)])
    np.testing.assert_array_equal(log.q_rad, [wave(4_000_000 * k - 30_000_000, ARM)[0] for k in range(100)])
    np.testing.assert_array_equal(log.qd_rad_s[7], wave(4_000_000 * 7 - 30_000_000, ARM)[1])


def test_prefixes_partial_messages_and_repeats_are_reported(tmp_path):
    names = [f"ur5e_{name}" for name in ALPHABETICAL]
    sent = joint_states(names=names, speeds=False)
    sent[50] = Sent(
        "/joint_states",
        JOINT_STATE,
        sent[50].stamp_ns,
        sent[50].receive_ns,
        {
            "name": ["gripper"],
            "position": np.zeros(1),
            "velocity": np.zeros(0),
            "effort": np.zeros(0),
        },
    )
    sent[60].stamp_ns = sent[59].stamp_ns
    path = write_bag(tmp_path, "mcap", sent)
    run = import_joints(path, tmp_path / "trial", namings=[ARM, [*ARM, "not there"]])
    assert run.joint_names == ARM
    assert run.rows == 198
    assert run.timing.duplicates == 1
    assert "1 of 200 messages do not have all joints" in run.warnings[0]
    assert "ur5e_elbow_joint of the bag is elbow_joint" in run.warnings
    assert [gap.missing for gap in run.timing.gaps] == [1, 1]
    assert np.isnan(read_run(tmp_path / "trial")[1].qd_rad_s).all()


def test_held_joints_are_read_if_the_bag_has_them(tmp_path):
    path = write_bag(tmp_path, "mcap", joint_states())
    run = import_joints(path, tmp_path / "trial", namings=[ARM, ["finger", *ARM]])
    assert run.joint_names == ["finger", *ARM]
    log = read_run(tmp_path / "trial")[1]
    np.testing.assert_array_equal(log.q_rad[3], wave(6_000_000, ["finger", *ARM])[0])


def test_the_bag_of_another_arm_is_refused(tmp_path):
    path = write_bag(tmp_path, "rosbag1", joint_states(names=["panda_joint1", "panda_joint2"]))
    with pytest.raises(StrandcastError, match="SC-I006") as refusal:
        import_joints(path, tmp_path / "trial", namings=[ARM])
    assert "panda_joint1" in refusal.value.what
    assert import_joints(path, tmp_path / "trial").joint_names == ["panda_joint1", "panda_joint2"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_bag_is_one_clear_error(tmp_path, kind):
    path = write_bag(tmp_path, kind, joint_states())
    file = path if path.is_file() else next(f for f in path.iterdir() if f.suffix in (".mcap", ".db3"))
    whole = file.read_bytes()
    for data in (b"", whole[:100], whole[: len(whole) // 2]):
        file.write_bytes(data)
        with pytest.raises(StrandcastError, match="SC-I001|SC-I042") as refusal:
            import_joints(path, tmp_path / "trial", namings=[ARM])
        assert refusal.value.fix
    (tmp_path / "unclosed").mkdir()
    with pytest.raises(StrandcastError, match="SC-I001") as refusal:
        import_joints(tmp_path / "unclosed", tmp_path / "trial", namings=[ARM])
    assert "reindex" in refusal.value.fix
    with pytest.raises(StrandcastError, match="SC-I001"):
        import_joints(tmp_path / "none.bag", tmp_path / "trial", namings=[ARM])
    assert not (tmp_path / "trial").exists()


def test_the_motions_start_is_found_in_a_bag(tmp_path, project_root):
    from strandcast.arm.load import load_arm
    from strandcast.arm.servo import respond
    from strandcast.records.motion import Motion, Robot, StartPosture, points_of

    arm = load_arm(project_root / "config" / "arms" / "planar3.toml").planar()
    time_s = np.arange(201) * 0.002
    s = (time_s / 0.4)[:, None]
    q = np.array([0.3, -0.6, -0.5]) + np.array([0.7, 0.9, 0.8]) * s**3 * (10 - 15 * s + 6 * s**2)
    qd = np.gradient(q, time_s, axis=0)
    motion = Motion(
        experiment="e",
        trial=1,
        target_m=[0.5, 0.5],
        robot=Robot(name=arm.name, file_sha256=arm.sha256, urdf_sha256=arm.urdf_sha256),
        joint_names=list(arm.joints),
        start=StartPosture(positions_rad=q[0].tolist(), tolerance_rad=[0.01] * 3),
        bezier=None,
        points=points_of(np.round(time_s * 1e9).astype(int), q, qd, np.gradient(qd, time_s, axis=0)),
        predicted=None,
        provenance=None,
    )
    log_s = np.arange(1000) * 0.002
    command = np.stack([np.interp(log_s - 0.7531, time_s, joint) for joint in q.T], axis=1)
    followed = respond(arm.servo, log_s, command)
    sent = [
        Sent(
            "/joint_states",
            JOINT_STATE,
            START_NS + 2_000_000 * k,
            START_NS + 2_000_000 * k,
            {
                "name": list(arm.joints),
                "position": row,
                "velocity": np.zeros(0),
                "effort": np.zeros(0),
            },
        )
        for k, row in enumerate(followed)
    ]
    path = write_bag(tmp_path, "mcap", sent)
    run = import_joints(path, tmp_path / "trial", namings=[list(arm.joints)], played=Played(motion, arm))
    assert run.motion_sha256 == motion.content_sha256()
    assert run.motion_start_s - START_NS * 1e-9 == pytest.approx(0.7531, abs=5e-4)
    log = read_run(tmp_path / "trial")[1]
    assert np.isfinite(log.since_start_s).sum() == pytest.approx(200, abs=1)


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_bag_is_refused_or_read(tmp_path, kind):
    from ...faults.fuzzing import fuzz
    from ...faults.readers import readers

    reader = readers()[f"bag, {kind}"]
    assert fuzz(reader, 300, tmp_path).faults(reader) == []


def test_channels_that_are_not_of_ros_are_left_out(tmp_path):
    mcap = pytest.importorskip("mcap.writer", reason="mcap is not installed: make test-drivers")
    from mcap.reader import make_reader

    (bag,) = write_bag(tmp_path, "mcap", joint_states()).glob("*.mcap")
    with bag.open("rb") as recorded, (tmp_path / "log.mcap").open("wb") as file:
        writer = mcap.Writer(file, compression=mcap.CompressionType.NONE)
        writer.start(profile="ros2")
        for encoding, kind in (("jsonschema", "json"), ("protobuf", "protobuf")):
            note = writer.register_schema("note", encoding, b"{}")
            channel = writer.register_channel(f"/{kind}", kind, note)
            writer.add_message(channel, log_time=START_NS, data=b"{}", publish_time=START_NS)
        channel = 0
        for schema, topic, message in make_reader(recorded).iter_messages():
            if not channel:
                joint_state = writer.register_schema(schema.name, schema.encoding, schema.data)
                channel = writer.register_channel(topic.topic, topic.message_encoding, joint_state)
            writer.add_message(channel, message.log_time, message.data, message.publish_time)
        writer.finish()
    for name, path in (("plain", bag), ("beside", tmp_path / "log.mcap")):
        import_joints(path, tmp_path / name, namings=[ARM])
    assert (tmp_path / "plain/joints.csv").read_bytes() == (tmp_path / "beside/joints.csv").read_bytes()
