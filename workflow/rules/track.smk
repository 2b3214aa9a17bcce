"""The one decoding pass: string to mass points, hand markers, picture of the throw.

REQUIRED INPUTS: the trial's manifest (and the video that it speaks of), results/<experiment>/camera.json
OUTPUTS:         results/<experiment>/trial-NN/{track.parquet, markers.parquet, track.json, strobe.webp}
"""


rule track:
    input:
        manifest="results/{experiment}/trial-{trial}/manifest.json",
        camera="results/{experiment}/camera.json",
        arm=arm_files,
        background=background_file,
    output:
        track="results/{experiment}/trial-{trial}/track.parquet",
        markers="results/{experiment}/trial-{trial}/markers.parquet",
        summary="results/{experiment}/trial-{trial}/track.json",
        strobe="results/{experiment}/trial-{trial}/strobe.webp",
    log:
        "results/{experiment}/trial-{trial}/logs/track.log",
    benchmark:
        "results/{experiment}/trial-{trial}/logs/track.jsonl"
    params:
        settings=stage_settings("track"),
        code=code_version("track"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the string is tracked"
    shell:
        "python -m strandcast track {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
