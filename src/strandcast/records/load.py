"""`strandcast.load`: any result file as a pandas table or as a record."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from strandcast.errors import StrandcastError
from strandcast.records.alignment import HAND, Alignment
from strandcast.records.camera import Camera
from strandcast.records.clip import Clip
from strandcast.records.estimate import ENSEMBLE, SIMULATED, Estimate
from strandcast.records.joint_log import Run, column_names, read_joint_log
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.manifest import Manifest
from strandcast.records.motion import Motion
from strandcast.records.observations import OBSERVATIONS
from strandcast.records.predicted import PREDICTED_THROWS
from strandcast.records.record import Record, read_json, refusal
from strandcast.records.summary import ExperimentSummary
from strandcast.records.tables import (
    TableSpec,
    read_arrow,
    read_parquet,
    table_facts,
    table_made_by,
    table_schema,
)
from strandcast.records.track import MARKERS, TRACK, TrackSummary
from strandcast.records.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd

RECORDS: dict[str, type[Record]] = {
    kind.SCHEMA: kind
    for kind in (
        *(Alignment, Camera, Clip, Estimate, ExperimentSummary),
        *(Manifest, Motion, Run, TrackSummary, Verdict),
    )
}
TABLES: dict[str, TableSpec] = {
    spec.schema: spec
    for spec in (ENSEMBLE, HAND, LAB_TRUTH, MARKERS, OBSERVATIONS, PREDICTED_THROWS, SIMULATED, TRACK)
}
# Units by the end of a column's name in joints.csv.
LOG_UNITS = {"_rad_s": "rad/s", "_rad": "rad", "_time_ns": "ns", "_time_s": "s", "_start_s": "s"}


def load(path: str | Path) -> Record | pd.DataFrame:
    """Return a result file: a record for ``.json``, a pandas table for ``.parquet`` and ``joints.csv``.

    Parameters
    ----------
    path
        The file, e.g. ``results/demo/trial-01/track.parquet``.

    Returns
    -------
    Record or pandas.DataFrame
        A record is a pydantic object with typed fields. A table describes itself in ``attrs``: ``units`` (by
        column), ``schema``, ``version``, ``made_by`` (versions) and ``facts`` (values stored beside it).

    Raises
    ------
    StrandcastError
        SC-R002 the file is not a result of strandcast; otherwise as the readers of `strandcast.records`.
    """
    path = Path(path)
    if path.suffix == ".json":
        return _load_record(path)
    if path.suffix == ".parquet":
        return _load_table(path)
    if path.suffix == ".csv":
        return _load_joint_log(path)
    raise _refusal(path, f"the suffix {path.suffix!r} is not one of .json, .parquet, .csv")


def _load_record(path: Path) -> Record:
    schema = read_json(path).get("schema")
    if not isinstance(schema, str) or schema not in RECORDS:
        raise _refusal(path, f"its schema {schema!r} is not known")
    return RECORDS[schema].read(path)


def _load_table(path: Path) -> pd.DataFrame:
    schema, _ = table_schema(read_parquet(path))
    if schema not in TABLES:
        raise _refusal(path, f"its schema {schema!r} is not known")
    table = read_arrow(path, TABLES[schema])
    frame: pd.DataFrame = table.to_pandas(use_threads=False)
    columns = TABLES[schema].columns | TABLES[schema].optional
    frame.attrs = {
        # Not those in the file, which no hash covers.
        "units": {name: columns[name].unit if name in columns else "" for name in table.column_names},
        "schema": schema,
        "version": TABLES[schema].version,
        "made_by": table_made_by(table),
        "facts": table_facts(table),
    }
    return frame


def _load_joint_log(path: Path) -> pd.DataFrame:
    import pandas as pd

    log = read_joint_log(path)
    seq, *names = column_names(log.joint_names)
    joints = [column for block in log.blocks() for column in block.T]
    columns = [log.host_time_ns, log.time_s, log.since_start_s, *joints, log.flags]
    index = pd.RangeIndex(len(log.time_s), name=seq)
    frame = pd.DataFrame(dict(zip(names, columns, strict=True)), index=index)
    frame.attrs = {"units": {name: _log_unit(name) for name in names}}
    return frame


def _log_unit(name: str) -> str:
    return next((unit for end, unit in LOG_UNITS.items() if name.endswith(end)), "1")


def _refusal(path: Path, what: str) -> StrandcastError:
    fix = "give a JSON record, a Parquet table or joints.csv of strandcast"
    return refusal("SC-R002", path, None, what, fix)
