"""The next motion.

REQUIRED INPUTS: the latest estimate and ensemble; motions, tracks and hands of the trials so far; the arm's file
OUTPUTS:         results/<experiment>/trial-NN/{motion.json, predicted.parquet}, made from the trials before NN
"""


rule plan:
    input:
        unpack(stage_inputs("plan")),
    output:
        **stage_outputs("plan"),
    log:
        "results/{experiment}/trial-{trial}/logs/plan.log",
    wildcard_constraints:
        experiment=targets.experiment_pattern(THROWN, other=True),
    group:
        shard_of("plan")
    threads: 2
    resources:
        mem_mb=memory_of("plan"),
        runtime=runtime_of("plan"),
    params:
        settings=stage_settings("plan"),
        code=code_version("plan"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the motion is planned"
    shell:
        "NUMBA_NUM_THREADS={threads} strandcast plan {wildcards.experiment:q} {wildcards.trial}"
        " 2>&1 | tee {log:q} >&2"


# Nothing is planned over a throw of a real arm: the file beside the raw files, if any, is the trial's motion.
rule register_motion:
    input:
        unpack(stage_inputs("register_motion")),
    output:
        **stage_outputs("register_motion"),
    log:
        "results/{experiment}/trial-{trial}/logs/register_motion.log",
    wildcard_constraints:
        experiment=targets.experiment_pattern(PLAYED),
    group:
        shard_of("register_motion")
    resources:
        mem_mb=memory_of("register_motion"),
        runtime=runtime_of("register_motion"),
    params:
        code=code_version("register_motion"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the motion that was played is registered"
    shell:
        "strandcast stage register-motion {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
