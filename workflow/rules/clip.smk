"""The throw as a small video and a film strip, for the trial's page.

REQUIRED INPUTS: the trial's video, manifest.json, track.parquet, track.json, results/<experiment>/cameras/*.json
OUTPUTS:         results/<experiment>/trial-NN/clip.json
"""


rule clip:
    input:
        unpack(stage_inputs("clip")),
    output:
        **stage_outputs("clip"),
    log:
        "results/{experiment}/trial-{trial}/logs/clip.log",
    wildcard_constraints:
        experiment=targets.experiment_pattern(SUPPLIED, other=True),
    group:
        shard_of("clip")
    resources:
        mem_mb=memory_of("clip"),
        runtime=runtime_of("clip"),
    params:
        settings=stage_settings("clip"),
        code=code_version("clip"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the film of the throw is cut"
    shell:
        "strandcast stage clip {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
