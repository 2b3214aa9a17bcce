"""Camera clock to robot clock.

REQUIRED INPUTS: the trial's markers.parquet, track.json, manifest.json and joint log; the arm's file
OUTPUTS:         results/<experiment>/trial-NN/{alignment.json, hand.parquet}
"""


rule align:
    input:
        manifest="results/{experiment}/trial-{trial}/manifest.json",
        markers="results/{experiment}/trial-{trial}/markers.parquet",
        track="results/{experiment}/trial-{trial}/track.json",
        log=raw_log,
        arm=arm_files,
    output:
        alignment="results/{experiment}/trial-{trial}/alignment.json",
        hand="results/{experiment}/trial-{trial}/hand.parquet",
    log:
        "results/{experiment}/trial-{trial}/logs/align.log",
    benchmark:
        "results/{experiment}/trial-{trial}/logs/align.jsonl"
    params:
        settings=stage_settings("align"),
        code=code_version("align"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the camera's clock is set by the robot's"
    shell:
        "python -m strandcast align {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"


# A lab that measures otherwise (motion capture) hands in track and alignment beside its raw files.
ruleorder: supply > track
ruleorder: supply > align


rule supply:
    input:
        track="data/{experiment}/trial-{trial}/track.parquet",
        summary="data/{experiment}/trial-{trial}/track.json",
        alignment="data/{experiment}/trial-{trial}/alignment.json",
        hand="data/{experiment}/trial-{trial}/hand.parquet",
    output:
        track="results/{experiment}/trial-{trial}/track.parquet",
        summary="results/{experiment}/trial-{trial}/track.json",
        alignment="results/{experiment}/trial-{trial}/alignment.json",
        hand="results/{experiment}/trial-{trial}/hand.parquet",
    log:
        "results/{experiment}/trial-{trial}/logs/supply.log",
    benchmark:
        "results/{experiment}/trial-{trial}/logs/supply.jsonl"
    params:
        settings=stage_settings("supply"),
        code=code_version("supply"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the supplied track is taken in"
    shell:
        "python -m strandcast supply {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
