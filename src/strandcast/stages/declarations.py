"""The input files, output files and settings of each stage, declared once.

The rules, their `params` and the checks are made from these declarations. A stage opens no other file under
data/, results/ or config/ than its inputs, its `may_read` files, and experiment.yaml.
"""

from strandcast.config.experiment import Experiment
from strandcast.stages import files, page_files
from strandcast.stages.files import (
    LAB_PHOTOS,
    SUPPLIED_FILES,
    Scope,
    every,
    every_or_excluded,
    latest,
    logged,
    past,
    played_motions,
    raw,
    recent,
    results,
    so_far,
    this,
)
from strandcast.stages.job import Role, Stage

RAW = "data/{experiment}/trial-{trial}/"
TRIAL = "results/{experiment}/trial-{trial}/"
EXPERIMENT = "results/{experiment}/"
REHEARSAL = "data/{experiment}/rehearsal/"
CAMERA = EXPERIMENT + "cameras/{camera}"
_CALIBRATION = ("lens", "lens_name", "plane_photo", "board", "plane", "distortion", "string_offset_m")
_PLANNED = (
    *("string", "plan", "seed", "start_string", "workspace_m", "target_m", "objective", "hit_radius_m"),
    "method",
    *("estimate.dt_s", "estimate.search"),  # the search of the paper has its own last point
)
ALL_SETTINGS = tuple(Experiment.model_fields)  # the pages print all settings


def _throws(scope: Scope) -> dict[str, Role]:
    """Return the roles of throws, as the fit and the planner read them."""
    return {
        "track": results(scope, "track.parquet"),
        "alignment": results(scope, "alignment.json"),
        "hand": results(scope, "hand.parquet"),
        "summary": results(scope, "track.json"),
        "motion": played_motions(scope),
        "joints": logged(scope, "joints.csv"),
        "run": logged(scope, "run.json"),
    }


_DECLARED = (
    Stage(
        "lab_calibrate",
        inputs={"arm": files.arm},
        outputs={
            "photos": [f"data/{{experiment}}/{name}" for name in LAB_PHOTOS],
            "plane": "data/{experiment}/calibration/plane.png",
        },
        settings=(
            *("cameras.*.board", "cameras.*.plane", "workspace_m", "string.length_m", "seed", "target_m"),
            *("lab.camera", "align.led.place_m"),
        ),
    ),
    Stage(
        "lab_rehearse",
        inputs={"arm": files.arm},
        outputs={role: f"{REHEARSAL}{name}" for role, name in files.REHEARSED_FILES.items()},
        settings=(*_PLANNED, *(f"lab.{name}" for name in ("servo", "noise", "draws"))),
    ),
    Stage(
        "lab_throw",
        inputs={
            "motion": results(this, "motion.json"),
            "predicted": results(this, "predicted.parquet"),
            "plane": files.plane,
            "arm": files.arm,
        },
        outputs={
            "video": RAW + "video.mp4",
            "joints": RAW + "joints.csv",
            "run": RAW + "run.json",
            "motion": RAW + "motion.json",
            "predicted": RAW + "predicted.parquet",
            "truth": TRIAL + "lab_truth.parquet",
        },
        settings=(
            *("cameras.*.plane", "workspace_m", "string", "seed", "lab", "target_m"),
            "align.led.place_m",
        ),
    ),
    Stage(
        "lab_capture",
        inputs={
            "motion": results(this, "motion.json"),
            "predicted": results(this, "predicted.parquet"),
            "arm": files.arm,
        },
        outputs={
            "capture": RAW + "capture.csv",
            "joints": RAW + "joints.csv",
            "run": RAW + "run.json",
            "motion": RAW + "motion.json",
            "predicted": RAW + "predicted.parquet",
            **{role: RAW + name for role, name in SUPPLIED_FILES.items()},
            "truth": TRIAL + "lab_truth.parquet",
        },
        settings=("string", "seed", "lab", "target_m"),
    ),
    Stage(
        "ingest",
        inputs={
            "video": files.ingested,
            "joints": logged(this, "joints.csv"),
            "run": logged(this, "run.json"),
            "motion": played_motions(this),
        },
        outputs={"manifest": TRIAL + "manifest.json"},
        hashed_by_stage=("video",),
        settings=("cameras.*.frame_rate_hz", "cameras.*.missing_policy"),
        may_read={"others": files.other_manifests},
    ),
    Stage(
        "calibrate",
        inputs={"lens": files.lens, "plane": files.plane, "manifest": files.scaling_manifest},
        outputs={"camera": CAMERA + ".json", "picture": CAMERA + ".webp"},
        settings=(
            *(f"cameras.*.{name}" for name in _CALIBRATION),
            *("workspace_m", "string.length_m", "track.tracker"),
        ),
        may_read={"video": files.scaling_video},
    ),
    Stage(
        "track",
        inputs={
            "manifest": results(this, "manifest.json"),
            "cameras": files.cameras,
            "arm": files.arm,
            "background": files.background,
        },
        outputs={
            "observations": TRIAL + "observations.parquet",
            "summary": TRIAL + "track.json",
            "strobe": TRIAL + "strobe.webp",
            "clip": TRIAL + "clip.json",
        },
        settings=(
            *("string", "track", "cameras.*.exposure_s"),
            *(f"align.led.{name}" for name in ("place_m", "radius_m", "box_px", "gamma")),
        ),
        without_motion=("target_m",),
        may_read={"video": files.video},  # the manifest holds its hash
    ),
    Stage(
        "reconstruct",
        inputs={"observations": results(this, "observations.parquet"), "cameras": files.cameras},
        outputs={"track": TRIAL + "track.parquet", "markers": TRIAL + "markers.parquet"},
    ),
    Stage(
        "align",
        inputs={
            "manifest": results(this, "manifest.json"),
            "markers": results(this, "markers.parquet"),
            "summary": results(this, "track.json"),
            "joints": logged(this, "joints.csv"),
            "run": logged(this, "run.json"),
            "motion": played_motions(this),
            "arm": files.arm,
        },
        outputs={"alignment": TRIAL + "alignment.json", "hand": TRIAL + "hand.parquet"},
        settings=("align",),
    ),
    Stage(
        "join_views",
        inputs={
            "observations": files.of_views(results(this, "observations.parquet")),
            "summaries": files.of_views(results(this, "track.json")),
            "alignments": files.of_views(results(this, "alignment.json")),
            "manifests": files.of_views(results(this, "manifest.json")),
            "cameras": files.cameras,
            "boards": files.shared_boards,
        },
        outputs={role: TRIAL + name for role, name in SUPPLIED_FILES.items()},
        settings=("cameras.#", "cameras.*.board"),
    ),
    Stage(
        "register_track",
        inputs={"capture": files.lab_capture, **{role: raw(name) for role, name in SUPPLIED_FILES.items()}},
        outputs={role: TRIAL + name for role, name in SUPPLIED_FILES.items()},
        settings=("string.length_m", "string.points"),
    ),
    Stage(
        "score",
        inputs={
            "track": results(this, "track.parquet"),
            "summary": results(this, "track.json"),
            "alignment": results(this, "alignment.json"),
            "cameras": files.filming,
        },
        outputs={"verdict": TRIAL + "verdict.json"},
        settings=("target_m", "objective", "hit_radius_m"),
    ),
    Stage(
        "estimate",
        inputs={
            **_throws(recent),
            "previous": results(latest, "ensemble.parquet"),
            "arm": files.arm,
            "cameras": files.filming,
        },
        outputs={
            "estimate": TRIAL + "estimate.json",
            "ensemble": TRIAL + "ensemble.parquet",
            "simulated": TRIAL + "simulated.parquet",
        },
        settings=("string", "estimate", "seed", "target_m", "objective"),
    ),
    Stage(
        "plan",
        inputs={
            **_throws(past),
            "estimate": results(latest, "estimate.json"),
            "ensemble": results(latest, "ensemble.parquet"),
            "known_string": files.known_string,
            **{f"rehearsal_{role}": files.rehearsal(name) for role, name in files.REHEARSED_FILES.items()},
            "arm": files.arm,
        },
        outputs={"motion": TRIAL + "motion.json", "predicted": TRIAL + "predicted.parquet"},
        settings=_PLANNED,
        may_read={"known_experiment": files.known_experiment},
    ),
    Stage(
        "register_motion",
        inputs={"motion": raw("motion.json"), "predicted": files.raw_if_there(this, "predicted.parquet")},
        outputs={"motion": TRIAL + "motion.json", "predicted": TRIAL + "predicted.parquet"},
    ),
    Stage(
        "report",
        inputs={
            "results": page_files.shown(this),
            "next_motion": page_files.next_motion,
            "next_throw": page_files.next_throw,
            "previous": page_files.shown(latest),
            "arm": files.arm,
        },
        outputs={"page": TRIAL + "report.html"},
        settings=ALL_SETTINGS,
        may_read={
            "shown": results(so_far, *page_files.ON_PAGE),
            "verdict": results(this, "verdict.json"),
            "cameras": files.cameras,
            "strobes": files.strobes,
            "planned": page_files.motion_after,
            "expected": page_files.throws_after,
        },
    ),
    Stage(
        "summary",
        inputs={
            "motion": page_files.first_motion,
            "pages": results(every_or_excluded, "report.html"),
            "results": page_files.shown(every),
            "next_motion": page_files.next_motion,
            "arm": files.arm,
        },
        outputs={"page": EXPERIMENT + "report.html", "summary": EXPERIMENT + "summary.json"},
        settings=ALL_SETTINGS,
        may_read={
            "shown": results(every_or_excluded, *page_files.ON_PAGE),
            "cameras": files.cameras,
            "pictures": files.camera_pictures,
            "planned": page_files.motion_after,
        },
    ),
)

STAGES: dict[str, Stage] = {stage.name: stage for stage in _DECLARED}
