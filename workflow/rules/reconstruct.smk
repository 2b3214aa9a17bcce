"""Detections in pixels to the track in metres.

REQUIRED INPUTS: the trial's observations.parquet, results/<experiment>/cameras/*.json
OUTPUTS:         results/<experiment>/trial-NN/{track.parquet, markers.parquet}
"""


rule reconstruct:
    input:
        unpack(stage_inputs("reconstruct")),
    output:
        **stage_outputs("reconstruct"),
    log:
        "results/{experiment}/trial-{trial}/logs/reconstruct.log",
    wildcard_constraints:
        experiment=targets.experiment_pattern(SUPPLIED | JOINED, other=True)
        + targets.OR_CAMERA,
    group:
        shard_of("reconstruct")
    resources:
        mem_mb=memory_of("reconstruct"),
        runtime=runtime_of("reconstruct"),
    params:
        settings=stage_settings("reconstruct"),
        code=code_version("reconstruct"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the track is reconstructed in metres"
    shell:
        "strandcast stage reconstruct {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
