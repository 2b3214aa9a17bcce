"""Lens and plane of motion.

REQUIRED INPUTS: data/<experiment>/calibration/{lens-*.png or a video, plane.png}
OUTPUTS:         results/<experiment>/cameras/<camera>.{json, webp}
"""


rule calibrate:
    input:
        unpack(stage_inputs("calibrate")),
    output:
        **shown(stage_outputs("calibrate"), "Calibration", picture="camera"),
    log:
        "results/{experiment}/cameras/{camera}/logs/calibrate.log",
    wildcard_constraints:
        experiment=targets.EXPERIMENT + targets.OR_CAMERA,
    group:
        shard_of("calibrate")
    resources:
        mem_mb=memory_of("calibrate"),
        runtime=runtime_of("calibrate"),
    params:
        settings=stage_settings("calibrate"),
        code=code_version("calibrate"),
    message:
        "{wildcards.experiment}: lens and plane of motion of camera {wildcards.camera} are calibrated"
    shell:
        "strandcast stage calibrate {wildcards.experiment:q} 2>&1 | tee {log:q} >&2"
