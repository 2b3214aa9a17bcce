"""Did the tip hit? The loop's checkpoint: what comes after depends on the answer.

REQUIRED INPUTS: the trial's track.parquet, track.json and alignment.json
OUTPUTS:         results/<experiment>/trial-NN/verdict.json
"""


checkpoint judge:
    input:
        track="results/{experiment}/trial-{trial}/track.parquet",
        summary="results/{experiment}/trial-{trial}/track.json",
        alignment="results/{experiment}/trial-{trial}/alignment.json",
    output:
        verdict="results/{experiment}/trial-{trial}/verdict.json",
    log:
        "results/{experiment}/trial-{trial}/logs/judge.log",
    benchmark:
        "results/{experiment}/trial-{trial}/logs/judge.jsonl"
    params:
        settings=stage_settings("judge"),
        code=code_version("judge"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: did the tip hit?"
    shell:
        "python -m strandcast judge {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
