"""Files of high-speed cameras (Photron's pair, Phantom's cine), compared with independent readings."""

import hashlib
import struct
from pathlib import Path

import numpy as np
import pytest

from strandcast.errors import StrandcastError
from strandcast.video.checks import check_recorded
from strandcast.video.cine import cine_times_ns
from strandcast.video.ingest import camera_times, inspect_video
from strandcast.video.reader import open_video

SHAPE = (24, 32)


def frames_of(path: Path) -> np.ndarray:
    with open_video(path) as video:
        return np.stack([grey.copy() for _, _, grey in video])


def pack_12(frames: np.ndarray) -> bytes:
    """Concatenate every pixel's 12 bits, highest first."""
    bits = (frames.reshape(-1, 1) >> np.arange(11, -1, -1)) & 1
    return np.packbits(bits.astype(np.uint8)).tobytes()


def unpack(data: bytes, bits: int, shape: tuple[int, ...]) -> np.ndarray:
    ones = np.unpackbits(np.frombuffer(data, np.uint8)).reshape(-1, bits).astype(np.int64)
    return (ones @ (1 << np.arange(bits - 1, -1, -1))).reshape(shape)


def photron(folder: Path, frames: np.ndarray, bits: int, **fields: str) -> Path:
    """Write a Photron pair, with the header as text."""
    values = {
        "Record Rate(fps)": "2000",
        "Total Frame": str(len(frames)),
        "Image Width": str(SHAPE[1]),
        "Image Height": str(SHAPE[0]),
        "Color Type": "Mono",
        "Color Bit": str(bits),
        "EffectiveBit Depth": str(min(bits, 12)),
        "EffectiveBit Side": "Lower",
    }
    lines = [f"{name} : {value}\n" for name, value in (values | fields).items() if value]
    (folder / "v.cih").write_text("#Camera Information Header\n" + "".join(lines))
    (folder / "v.mraw").write_bytes(pack_12(frames) if bits == 12 else frames.tobytes())
    return folder / "v.cih"


@pytest.fixture
def frames() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 4096, (7, *SHAPE)).astype(np.uint16)


def test_a_note_of_sha256sum_may_be_of_one_file_or_of_both(tmp_path, frames):
    path = photron(tmp_path, frames, 12)
    facts = inspect_video(path)
    both = [hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() for name in ("v.cih", "v.mraw")]
    (tmp_path / "v.cih.sha256").write_text(f"{both[0]}  v.cih\n{both[1]}  v.mraw\n")
    (tmp_path / "v.mraw.sha256").write_text(both[1])
    check_recorded(path, facts, None)
    (tmp_path / "v.mraw.sha256").write_text(both[0])
    with pytest.raises(StrandcastError, match="v.mraw.sha256 has another SHA-256"):
        check_recorded(path, facts, None)


@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("given", ["v.cih", "v.mraw"])
def test_photrons_pixels_are_read_by_either_name(tmp_path, frames, bits, given):
    true = frames.astype(np.uint8) if bits == 8 else frames
    photron(tmp_path, true, bits)
    facts = inspect_video(tmp_path / given)
    assert (facts.packets, facts.width_px, facts.height_px) == (7, 32, 24)
    assert facts.frame_rate_hz == pytest.approx(2000)
    assert facts.size_bytes == sum(path.stat().st_size for path in tmp_path.iterdir())
    np.testing.assert_array_equal(frames_of(tmp_path / given), true)
    with open_video(tmp_path / given) as video:
        assert video.info.max_level == (255 if bits == 8 else 4095)


@pytest.mark.parametrize(
    ("fields", "code", "field"),
    [
        ({"Image Width": ""}, "SC-V005", "Image Width"),
        ({"Total Frame": "many"}, "SC-V005", "Total Frame"),
        ({"Total Frame": "-3"}, "SC-V005", "Total Frame"),
        ({"Image Width": "90000", "Image Height": "90000"}, "SC-V007", None),
        ({"Color Bit": "24"}, "SC-V010", "Color Bit"),
        ({"Color Type": "Color"}, "SC-V010", "Color Bit"),
    ],
)
def test_an_invalid_photron_header_is_refused(tmp_path, frames, fields, code, field):
    with pytest.raises(StrandcastError) as caught:
        inspect_video(photron(tmp_path, frames, 12, **fields))
    assert (caught.value.code, caught.value.field) == (code, field)
    assert caught.value.file == str(tmp_path / "v.cih")


def test_a_photron_header_in_xml_may_not_expand_to_more(tmp_path, frames):
    path = photron(tmp_path, frames, 12).rename(tmp_path / "v.cihx")
    path.write_text('<!DOCTYPE cih [<!ENTITY a "aaaa">]><cih><frameInfo>&a;</frameInfo></cih>')
    with pytest.raises(StrandcastError) as caught:
        inspect_video(path)
    assert caught.value.code == "SC-V005"


def test_real_photron_video(real_data):
    """README: 15 frames, 384 x 384, 30000 frames/s, 12 bits packed."""
    header = real_data / "highspeed_native" / "ball_12bit.cihx"
    data = header.with_suffix(".mraw")
    for path in (header, data):
        facts = inspect_video(path)
        assert (facts.packets, facts.header_frames) == (15, 15)
        assert (facts.width_px, facts.height_px) == (384, 384)
        assert facts.frame_rate_hz == pytest.approx(30000)
        np.testing.assert_array_equal(frames_of(path), unpack(data.read_bytes(), 12, (15, 384, 384)))


@pytest.mark.parametrize(
    ("size", "left"), [(4, 0), (8, 0), (13, 0), (8 + 16, 2), (8 + 24, 3), (2**32 - 1, 3)]
)
def test_a_damaged_block_of_time_stamps_gives_no_more_than_it_holds(tmp_path, size, left):
    from ..faults.readers import CINE_TIMES_AT, cine_file

    path = cine_file(tmp_path)
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, CINE_TIMES_AT, size)
    path.write_bytes(data)
    assert len(cine_times_ns(path) or []) == left


def test_the_frames_of_a_cine_have_the_cameras_own_times(tmp_path):
    from ..faults.readers import CINE_TIMES_AT, cine_file

    path = cine_file(tmp_path)
    data = bytearray(path.read_bytes())
    for frame in range(3):  # the header's nominal rate is another one
        struct.pack_into("<II", data, CINE_TIMES_AT + 8 + 8 * frame, frame * ((1 << 32) // 9000), 9)
    path.write_bytes(data)
    with open_video(path) as video:
        times = [time_s for _, time_s, _ in video]
    np.testing.assert_allclose(times, camera_times(inspect_video(path)), atol=1e-12)
    np.testing.assert_allclose(times, np.arange(3) / 9000, atol=2e-9)


def packed_cine_frames(path: Path) -> np.ndarray:
    """Read a cine file of 10 bits packed by its own table of images: (N, height, width) levels."""
    data = path.read_bytes()
    count, header, _, images = struct.unpack_from("<IIII", data, 20)
    width, height = struct.unpack_from("<ii", data, header + 4)
    size = width * height * 10 // 8
    places = np.frombuffer(data, "<u8", count, images)
    starts = [int(place) + struct.unpack_from("<I", data, place)[0] for place in places]
    return np.stack([unpack(data[start : start + size], 10, (height, width)) for start in starts])


def test_real_cine_video(real_data):
    """README: 235 frames, 256 x 32, frame rate field 100."""
    path = real_data / "highspeed_native" / "data_small_cine.cine"
    facts = inspect_video(path)
    assert (facts.packets, facts.header_frames) == (235, 235)
    assert (facts.width_px, facts.height_px) == (256, 32)
    assert facts.frame_rate_hz == pytest.approx(100)
    np.testing.assert_allclose(camera_times(facts), np.arange(235) / 100, atol=1e-9)
    # The camera's 10 bits are spread over 16.
    levels = packed_cine_frames(path)
    assert levels.max() < 1 << 10
    np.testing.assert_array_equal(frames_of(path) >> 6, levels)
    # Its last time stamp is damaged, which is reported; those before are the camera's.
    assert any("jump by 2.528e+07 s after frame 233" in note for note in facts.notes)
    times = cine_times_ns(path)
    assert times is not None
    np.testing.assert_allclose(np.diff(times[:-1]), 10_000_000, atol=2)


def test_a_cines_own_times_reveal_lost_frames(real_data, tmp_path):
    data = bytearray((real_data / "highspeed_native" / "data_small_cine.cine").read_bytes())
    setup = struct.unpack_from("<I", data, 28)[0]
    block = setup + struct.unpack_from("<H", data, setup + 142)[0]
    assert struct.unpack_from("<H", data, block + 4)[0] == 1002
    stamps = np.frombuffer(data, "<u8", 235, block + 8).copy()
    stamps[234] = stamps[233] + (1 << 32) // 100
    stamps[100:] += 3 * (1 << 32) // 100
    data[block + 8 : block + 8 + stamps.nbytes] = stamps.tobytes()
    (tmp_path / "v.cine").write_bytes(data)
    facts = inspect_video(tmp_path / "v.cine")
    assert [(gap.index, gap.missing) for gap in facts.gaps] == [(99, 3)]
    assert facts.notes == []
    assert camera_times(facts)[100] == pytest.approx(1.03, abs=1e-6)


@pytest.mark.parametrize("name", ["data_small_cine.cine", "ball_12bit.cihx"])
def test_a_rate_that_contradicts_the_cameras_clock_is_refused(real_data, name):
    path = real_data / "highspeed_native" / name
    true_hz = inspect_video(path).frame_rate_hz
    assert inspect_video(path, 1.01 * true_hz).frame_rate_source == "experiment"
    with pytest.raises(StrandcastError, match=f"clock gives {true_hz:.6g} frames/s") as caught:
        inspect_video(path, 10.0 * true_hz)
    assert caught.value.code == "SC-V017"
    assert "factor of 10" in caught.value.cost


def test_the_flips_of_a_cine_are_named(tmp_path):
    from ..faults.readers import cine_file

    path = cine_file(tmp_path)
    data = bytearray(path.read_bytes())
    upright = frames_of(path)
    assert not any("flip" in note for note in inspect_video(path).notes)
    struct.pack_into("<II", data, 84 + 756, 1, 1)
    path.write_bytes(data)
    notes = inspect_video(path).notes
    assert any("horizontal flip (bFlipH), which is not applied" in note for note in notes)
    assert any("vertical flip (bFlipV), which is applied" in note for note in notes)
    np.testing.assert_array_equal(frames_of(path), upright[:, ::-1])


@pytest.mark.parametrize("bits", [8, 16])
def test_a_cine_without_compression_is_read_the_right_way_up(real_data, tmp_path, bits):
    """Its rows are stored from bottom to top, as in a Windows bitmap."""
    data = bytearray((real_data / "highspeed_native" / "data_small_cine.cine").read_bytes())
    header, _, images = struct.unpack_from("<III", data, 24)
    levels = 1 << min(bits, 10)  # its header says that 10 of the bits count
    true = np.random.default_rng(0).integers(0, levels, (5, 32, 256)).astype(f"<u{bits // 8}")
    true[0] = np.arange(256)
    struct.pack_into("<I", data, 20, len(true))
    struct.pack_into("<iiHHII", data, header + 4, 256, 32, 1, bits, 0, true[0].nbytes)
    each = 8 + true[0].nbytes
    table = [images + 8 * len(true) + each * k for k in range(len(true))]
    pictures = [struct.pack("<II", 8, each - 8) + picture[::-1].tobytes() for picture in true]
    (tmp_path / "v.cine").write_bytes(data[:images] + struct.pack("<5Q", *table) + b"".join(pictures))
    found = frames_of(tmp_path / "v.cine")
    np.testing.assert_array_equal(found >> 6 if bits == 16 else found, true)
