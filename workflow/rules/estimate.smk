"""The string parameters, fitted to the newest throws.

REQUIRED INPUTS: track, alignment and hand of the newest trials, as many as estimate.trials says, and the motions that
                 were played; the previous estimate, from which the search starts (eq. 3's best exponents); the
                 cameras, whose error in the plane bounds what is said of the arm's file
OUTPUTS:         results/<experiment>/trial-NN/{estimate.json, ensemble.parquet, simulated.parquet}
"""


rule estimate:
    input:
        unpack(stage_inputs("estimate")),
    output:
        **stage_outputs("estimate"),
    log:
        "results/{experiment}/trial-{trial}/logs/estimate.log",
    group:
        shard_of("estimate")
    threads: 2
    resources:
        mem_mb=memory_of("estimate"),
        runtime=runtime_of("estimate"),
    params:
        settings=stage_settings("estimate"),
        code=code_version("estimate"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the string's parameters are estimated"
    shell:
        "NUMBA_NUM_THREADS={threads} strandcast estimate {wildcards.experiment:q} {wildcards.trial}"
        " 2>&1 | tee {log:q} >&2"
