"""The next motion.

REQUIRED INPUTS: the latest estimate and ensemble; motions, tracks and hands of the trials so far; the arm's file
OUTPUTS:         results/<experiment>/trial-NN/motion.json, made from the trials before NN
"""


rule plan:
    input:
        estimate=lambda w: results_of(
            w.experiment, earlier(w)[-1:], "estimate.json", "ensemble.parquet"
        ),
        trials=lambda w: results_of(
            w.experiment,
            earlier(w),
            "track.parquet",
            "alignment.json",
            "hand.parquet",
            "verdict.json",
        ),
        motions=lambda w: played_motions(w.experiment, earlier(w)),
        logs=lambda w: logs(w.experiment, earlier(w)),
        arm=arm_files,
    output:
        motion="results/{experiment}/trial-{trial}/motion.json",
    log:
        "results/{experiment}/trial-{trial}/logs/plan.log",
    benchmark:
        "results/{experiment}/trial-{trial}/logs/plan.jsonl"
    threads: 2
    params:
        settings=stage_settings("plan"),
        code=code_version("plan"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the motion is planned"
    shell:
        "NUMBA_NUM_THREADS={threads} python -m strandcast plan {wildcards.experiment:q} {wildcards.trial}"
        " 2>&1 | tee {log:q} >&2"


# What a real arm has played is never planned again: the motion beside the raw files is the trial's motion.
ruleorder: adopt > plan


rule adopt:
    input:
        motion="data/{experiment}/trial-{trial}/motion.json",
    output:
        motion="results/{experiment}/trial-{trial}/motion.json",
    log:
        "results/{experiment}/trial-{trial}/logs/plan.log",
    benchmark:
        "results/{experiment}/trial-{trial}/logs/plan.jsonl"
    wildcard_constraints:
        experiment=REAL_EXPERIMENTS,
    params:
        code=code_version("adopt"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the motion that was played is taken in"
    shell:
        "python -m strandcast adopt {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
