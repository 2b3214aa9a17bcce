"""The files of a tracked film: tables, netCDF, a film with the string drawn over it, and a page."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pandas as pd
from scipy.io import netcdf_file

from strandcast.camera.markers import eight_bit
from strandcast.film.page import film_page
from strandcast.film.result import FilmTrack
from strandcast.records.files import atomic_write, write_text
from strandcast.report.measures import runs
from strandcast.tracking.preconditions import open_ingested

BLUE, ORANGE, BLACK = (0, 114, 178), (230, 159, 0), (0, 0, 0)  # measured, flagged, their rim
CORRECTIONS = "corrections.csv"


def write_files(track: FilmTrack, folder: Path) -> list[Path]:
    """Write all files of a tracked film; return their paths, the page first."""
    folder.mkdir(parents=True, exist_ok=True)
    points = track.table()
    with atomic_write(folder / "points.parquet") as path:
        points.to_parquet(path, index=False)
    write_text(folder / "points.csv", points.to_csv(index=False, float_format="%.9g"))
    write_text(folder / "frames.csv", frame_table(track).to_csv(index=False, float_format="%.9g"))
    with atomic_write(folder / "points.nc") as path:
        write_netcdf(track, path)
    with atomic_write(folder / "overlay.mp4") as path:
        write_overlay(track, path)
    files = ["points.parquet", "points.csv", "frames.csv", "points.nc", "overlay.mp4"]
    write_text(folder / "film.html", film_page(track, files))
    return [folder / name for name in ("film.html", *files)]


def frame_table(track: FilmTrack) -> pd.DataFrame:
    """Return a row for each frame: length, speed of the end, largest curvature, whether it is doubtful."""
    unit, curved = track.unit, np.abs(track.curvature())
    largest = np.where(np.isfinite(curved).any(axis=1), np.nan_to_num(curved).max(axis=1), np.nan)
    return pd.DataFrame(
        {
            "frame": np.arange(len(track.time_s)),
            "time_s": track.time_s,
            f"length_{unit}": track.length,
            f"end_speed_{unit}_s": track.end_speed(),
            f"largest_curvature_1_{unit}": largest,
            "doubtful": track.doubtful().astype(int),
        }
    )


def write_netcdf(track: FilmTrack, path: Path) -> None:
    """Write the points as the package `movement` stores poses: time, space, keypoints, individuals."""
    keypoints = [f"point-{k:03d}" for k in range(track.flags.shape[1])]
    labels = {"space": ["x", "y"], "keypoints": keypoints, "individuals": ["string"]}
    about = {"ds_type": "poses", "source_software": "strandcast", "time_unit": "seconds"}
    with netcdf_file(path, "w") as made:
        file: Any = made  # attributes of the file are set as attributes of the object
        file.createDimension("time", len(track.time_s))
        for name, words in labels.items():
            letters = np.array(words, "S")
            file.createDimension(name, len(words))
            file.createDimension(f"{name}_letters", letters.itemsize)
            column = file.createVariable(name, "c", (name, f"{name}_letters"))
            column[:] = letters.view("S1").reshape(len(words), -1)
            column._Encoding = "utf-8"
        file.createVariable("time", "d", ("time",))[:] = track.time_s
        position = file.createVariable("position", "d", ("time", *labels))
        position[:] = np.moveaxis(track.points_px, 2, 1)[..., None]
        position.units = "px"
        confidence = file.createVariable("confidence", "d", ("time", "keypoints", "individuals"))
        confidence[:] = track.confidence()[..., None]
        for name, text in about.items():
            setattr(file, name, text)
        file.fps = float(track.facts.frame_rate_hz)


def write_overlay(track: FilmTrack, path: Path) -> None:
    """Write the film in grey with the string drawn over it: blue, orange where it is doubtful."""
    facts, shown_px = track.facts, np.rint(16 * track.points_px)
    doubt = track.confidence() < 1.0
    with open_ingested(track.video, facts) as opened, av.open(path, "w") as made:
        stream = made.add_stream(
            "libx264", rate=Fraction(facts.frame_rate_hz).limit_denominator(1001), options={"crf": "20"}
        )
        stream.width, stream.height = facts.width_px // 2 * 2, facts.height_px // 2 * 2
        stream.pix_fmt = "yuv420p"
        for index, _, image in opened:
            picture = cv2.cvtColor(eight_bit(image), cv2.COLOR_GRAY2RGB)
            shown = np.isfinite(shown_px[index]).all(axis=1)
            for first, last in runs(shown):
                line = shown_px[index, first : last + 1].astype(np.int32)
                cv2.polylines(picture, [line], False, BLACK, 3, cv2.LINE_AA, 4)
                cv2.polylines(picture, [line], False, BLUE, 1, cv2.LINE_AA, 4)
            for k in np.flatnonzero(shown):
                colour = ORANGE if doubt[index, k] else BLUE
                cv2.circle(picture, shown_px[index, k].astype(int).tolist(), 40, colour, -1, cv2.LINE_AA, 4)
            frame = av.VideoFrame.from_ndarray(picture[: stream.height, : stream.width], format="rgb24")
            made.mux(stream.encode(frame))
        made.mux(stream.encode(None))
