"""A camera perpendicular to the plane; only its scale is known."""

from strandcast.records.camera import Camera, Lens

FOCAL_OVER_WIDTH = 20.0  # chosen: nearly parallel rays, so that offsets from the plane do not matter


def flat_camera(
    width_px: int,
    height_px: int,
    scale_m_per_px: float,
    origin_px: tuple[float, float],
    source: str = "given",
) -> Camera:
    """Return a camera without distortion or tilt: x_m = scale · (u − u0), y_m = −scale · (v − v0).

    `origin_px` (u0, v0) is the pixel of the world's origin. `source` says where the scale is from: ``given``,
    ``hand`` (its markers' size), or what a tracker names, as ``arc``.
    """
    focal_px = FOCAL_OVER_WIDTH * width_px
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
