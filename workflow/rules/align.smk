"""Camera clock to robot clock.

REQUIRED INPUTS: the trial's markers.parquet, track.json, manifest.json, joint log and played motion; the arm's file
OUTPUTS:         results/<experiment>/trial-NN/{alignment.json, hand.parquet}
"""


rule align:
    input:
        unpack(stage_inputs("align")),
    output:
        **stage_outputs("align"),
    log:
        "results/{experiment}/trial-{trial}/logs/align.log",
    wildcard_constraints:
        experiment=targets.experiment_pattern(SUPPLIED | JOINED, other=True)
        + targets.OR_CAMERA,
    group:
        shard_of("align")
    resources:
        mem_mb=memory_of("align"),
        runtime=runtime_of("align"),
    params:
        settings=stage_settings("align"),
        code=code_version("align"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the camera's clock is aligned with the robot's"
    shell:
        "strandcast stage align {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"


# What several cameras saw becomes one track in space.
rule join_views:
    input:
        unpack(stage_inputs("join_views")),
    output:
        **stage_outputs("join_views"),
    log:
        "results/{experiment}/trial-{trial}/logs/join_views.log",
    wildcard_constraints:
        experiment=targets.experiment_pattern(JOINED),
    group:
        shard_of("join_views")
    resources:
        mem_mb=memory_of("join_views"),
        runtime=runtime_of("join_views"),
    params:
        settings=stage_settings("join_views"),
        code=code_version("join_views"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: what the cameras saw is joined to a track in space"
    shell:
        "strandcast stage join-views {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"


# A track that was measured elsewhere counts, also where several cameras filmed the throw.
ruleorder: register_track > join_views


# Where another system (motion capture) measured track and alignment, they are supplied beside the raw files.
rule register_track:
    input:
        unpack(stage_inputs("register_track")),
    output:
        **stage_outputs("register_track"),
    log:
        "results/{experiment}/trial-{trial}/logs/register_track.log",
    wildcard_constraints:
        experiment=targets.experiment_pattern(SUPPLIED),
    group:
        shard_of("register_track")
    resources:
        mem_mb=memory_of("register_track"),
        runtime=runtime_of("register_track"),
    params:
        settings=stage_settings("register_track"),
        code=code_version("register_track"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the supplied track is registered"
    shell:
        "strandcast stage register-track {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
