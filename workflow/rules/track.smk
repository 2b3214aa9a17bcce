"""The one decoding pass: string and hand markers in pixels, picture and film of the throw.

REQUIRED INPUTS: the trial's manifest (and the video it describes), results/<experiment>/cameras/*.json
OUTPUTS:         results/<experiment>/trial-NN/{observations.parquet, track.json, strobe.webp, clip.json}
"""


rule track:
    input:
        unpack(stage_inputs("track")),
    output:
        **shown(stage_outputs("track"), "Trials", strobe="strobe"),
    log:
        "results/{experiment}/trial-{trial}/logs/track.log",
    wildcard_constraints:
        experiment=targets.experiment_pattern(SUPPLIED | JOINED, other=True)
        + targets.OR_CAMERA,
    group:
        shard_of("track")
    resources:
        mem_mb=memory_of("track"),
        runtime=runtime_of("track"),
    params:
        settings=stage_settings("track"),
        code=code_version("track"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the string is tracked"
    shell:
        "strandcast track {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
