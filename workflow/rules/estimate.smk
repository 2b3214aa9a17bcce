"""The string that explains the throws so far.

REQUIRED INPUTS: track, alignment, hand and verdict of the trials so far; the previous estimate (eq. 3's best exponents);
                 the motions that were played
OUTPUTS:         results/<experiment>/trial-NN/{estimate.json, ensemble.parquet, simulated.parquet}
"""


rule estimate:
    input:
        trials=lambda w: results_of(
            w.experiment,
            so_far(w),
            "track.parquet",
            "track.json",
            "alignment.json",
            "hand.parquet",
            "verdict.json",
        ),
        previous=lambda w: results_of(
            w.experiment, earlier(w)[-1:], "estimate.json", "ensemble.parquet"
        ),
        motions=lambda w: played_motions(w.experiment, so_far(w)),
        logs=lambda w: logs(w.experiment, so_far(w)),
        arm=arm_files,
    output:
        estimate="results/{experiment}/trial-{trial}/estimate.json",
        ensemble="results/{experiment}/trial-{trial}/ensemble.parquet",
        simulated="results/{experiment}/trial-{trial}/simulated.parquet",
    log:
        "results/{experiment}/trial-{trial}/logs/estimate.log",
    benchmark:
        "results/{experiment}/trial-{trial}/logs/estimate.jsonl"
    threads: 2
    params:
        settings=stage_settings("estimate"),
        code=code_version("estimate"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the string is estimated"
    shell:
        "NUMBA_NUM_THREADS={threads} python -m strandcast estimate {wildcards.experiment:q} {wildcards.trial}"
        " 2>&1 | tee {log:q} >&2"
