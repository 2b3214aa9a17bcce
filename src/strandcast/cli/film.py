"""The command that tracks a string in a film without an experiment."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from strandcast.cli.common import AsJson, show


def film(
    video: Annotated[Path, typer.Argument(metavar="FILM", help="A film, or a folder of pictures.")],
    length: Annotated[float | None, typer.Option(min=1e-4, help="Length beyond the held end [m].")] = None,
    scale: Annotated[
        str | None,
        typer.Option(
            help="Metres per pixel, 100,200:400,200=0.30 (two pixels, their distance), marker=0.04 (side), "
            "or a camera's .json.  [default: by the length, else pixels]"
        ),
    ] = None,
    held: Annotated[
        list[str] | None,
        typer.Option(
            metavar="U,V",
            help="Held end: U,V in pixels; moving:U,V; marker:ID. Give it twice if both ends are held.  "
            "[default: where all frames agree]",
        ),
    ] = None,
    points: Annotated[int, typer.Option(min=2, max=100, help="Points beyond the held end.")] = 20,
    polarity: Annotated[
        Literal["auto", "dark", "bright"],
        typer.Option(help="Whether the string is darker or brighter than its background."),
    ] = "auto",
    colour: Annotated[str | None, typer.Option(help="Colour of the string: '#c03020'.")] = None,
    frame_rate: Annotated[
        float | None,
        typer.Option(min=0.1, max=1e6, help="True frame rate, if the film has another [1/s]."),
    ] = None,
    exposure: Annotated[
        float | None,
        typer.Option(min=1e-7, max=1.0, help="Exposure [s].  [default: a fifth of a frame]"),
    ] = None,
    dictionary: Annotated[str, typer.Option(help="OpenCV's name of the markers.")] = "DICT_4X4_50",
    out: Annotated[
        Path | None, typer.Option(help="Folder to write to.  [default: the film's name, as swing-track]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Track a string in a film, without an arm: tables, netCDF, an overlay and a page."""
    from strandcast.film.files import CORRECTIONS, write_files
    from strandcast.film.track import track_film

    folder = out or Path(f"{video.stem}-track")
    if folder.is_file() or folder.resolve() == video.resolve():
        raise typer.BadParameter(f"{folder} is the film itself, or a file", param_hint="--out")
    corrections = folder / CORRECTIONS
    track = track_film(
        video,
        length_m=length,
        scale=scale,
        held=tuple(held or ()),
        points=points,
        polarity=polarity,
        colour=colour,
        frame_rate_hz=frame_rate,
        exposure_s=exposure,
        dictionary=dictionary,
        corrections=corrections if corrections.is_file() else None,
    )
    files = write_files(track, folder)
    doubtful = int(track.doubtful().sum())
    lines = [f"{name}: {words}" for name, words in track.assumed.items()]
    lines += [f"warning: {each}" for each in track.advice()]
    lines.append(
        f"{len(track.time_s)} frames of {points + 1} points, {doubtful} of them doubtful: {files[0]}"
    )
    content = {"files": files, "frames": len(track.time_s), "doubtful": doubtful, "warnings": track.advice()}
    show(as_json, content | {"assumed": track.assumed, "m_per_px": track.m_per_px}, lines)
