"""Raw files to a manifest: hashes, counts, time stamps, gaps.

REQUIRED INPUTS: data/<experiment>/trial-NN/{video.*, joints.csv, run.json, motion.json}
OUTPUTS:         results/<experiment>/trial-NN/manifest.json
"""


rule ingest:
    input:
        unpack(stage_inputs("ingest")),
    output:
        **stage_outputs("ingest"),
    log:
        "results/{experiment}/trial-{trial}/logs/ingest.log",
    wildcard_constraints:
        experiment=targets.EXPERIMENT + targets.OR_CAMERA,
    group:
        shard_of("ingest")
    resources:
        mem_mb=memory_of("ingest"),
        runtime=runtime_of("ingest"),
    params:
        settings=stage_settings("ingest"),
        code=code_version("ingest"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: raw files are hashed and counted"
    shell:
        "strandcast stage ingest {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
