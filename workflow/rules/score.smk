"""Did the throw hit? In the lab the loop's checkpoint: its answer decides whether another trial follows.

REQUIRED INPUTS: the trial's track.parquet, track.json and alignment.json
OUTPUTS:         results/<experiment>/trial-NN/verdict.json
"""


rule score:
    input:
        unpack(stage_inputs("score")),
    output:
        **stage_outputs("score"),
    log:
        "results/{experiment}/trial-{trial}/logs/score.log",
    wildcard_constraints:
        experiment=RECORDED_EXPERIMENTS,
    group:
        shard_of("score")
    resources:
        mem_mb=memory_of("score"),
        runtime=runtime_of("score"),
    params:
        settings=stage_settings("score"),
        code=code_version("score"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the throw is scored"
    shell:
        "strandcast stage score {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"


# After every checkpoint Snakemake works out again all that is left to do, in vain where all trials are recorded.
checkpoint score_lab:
    input:
        unpack(stage_inputs("score")),
    output:
        **stage_outputs("score"),
    log:
        "results/{experiment}/trial-{trial}/logs/score.log",
    wildcard_constraints:
        experiment=LAB_EXPERIMENTS,
    group:
        shard_of("score")
    resources:
        mem_mb=memory_of("score"),
        runtime=runtime_of("score"),
    params:
        settings=stage_settings("score"),
        code=code_version("score"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the throw is scored"
    shell:
        "strandcast stage score {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
