"""A camera that looks straight at the plane, where only the scale is known."""

from __future__ import annotations

from strandcast.records.camera import Camera, Lens

FAR = 20.0  # focal length over picture width: nearly parallel rays, so that offsets do not matter


def flat_camera(
    width_px: int,
    height_px: int,
    scale_m_per_px: float,
    origin_px: tuple[float, float],
    source: str = "given",
) -> Camera:
    """Return a camera without distortion or tilt: x_m = scale · (u − u0), y_m = −scale · (v − v0).

    Parameters
    ----------
    width_px, height_px
        Size of the picture.
    scale_m_per_px
        Metres in the plane that a pixel covers.
    origin_px
        Where the world's origin is in the picture.
    source
        How the scale is known: ``given``, or ``arc`` (a pendulum of known length).
    """
    focal_px = FAR * width_px
    lens = Lens(
        width_px=width_px,
        height_px=height_px,
        rms_px=0.0,
        distortion=[0.0] * 5,
        matrix=[[focal_px, 0.0, origin_px[0]], [0.0, focal_px, origin_px[1]], [0.0, 0.0, 1.0]],
    )
    return Camera(
        lens=lens,
        rotation=[[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        translation_m=[0.0, 0.0, focal_px * scale_m_per_px],
        plane_rms_px=0.0,
        plane_markers=[],
        string_offset_m=0.0,
        scale_m_per_px=scale_m_per_px,
        source=source,
    )
