"""The virtual rig, for experiments without a robot.

REQUIRED INPUTS: results/<experiment>/trial-NN/{motion.json, predicted.parquet}
OUTPUTS:         data/<experiment>/calibration/*,
                 data/<experiment>/rehearsal/{motion.json, joints.csv, run.json},
                 data/<experiment>/trial-NN/{video.mp4, joints.csv, run.json, motion.json, predicted.parquet};
                 in space capture.csv and {track.parquet, track.json, alignment.json, hand.parquet} for the video
STEPS:           lab_calibrate (calibration photos), lab_rehearse (plan the first motion, play it with an empty clamp),
                 lab_throw (play the motion, film it), in space lab_capture (play it, capture it, import the capture)
"""


rule lab_calibrate:
    input:
        unpack(stage_inputs("lab_calibrate")),
    output:
        **kept(stage_outputs("lab_calibrate")),
    log:
        "results/{experiment}/logs/lab_calibrate.log",
    wildcard_constraints:
        experiment=FILMED_IN_LAB,
    group:
        shard_of("lab_calibrate")
    resources:
        mem_mb=memory_of("lab_calibrate"),
        runtime=runtime_of("lab_calibrate"),
    params:
        settings=stage_settings("lab_calibrate"),
        code=code_version("lab_calibrate"),
    message:
        "{wildcards.experiment}: the lab photographs its calibration boards"
    shell:
        "strandcast stage lab-calibrate {wildcards.experiment:q} 2>&1 | tee {log:q} >&2"


rule lab_rehearse:
    input:
        unpack(stage_inputs("lab_rehearse")),
    output:
        **kept(stage_outputs("lab_rehearse")),
    log:
        "results/{experiment}/logs/lab_rehearse.log",
    wildcard_constraints:
        experiment=LAB_EXPERIMENTS,
    group:
        shard_of("lab_rehearse")
    threads: 2
    resources:
        mem_mb=memory_of("lab_rehearse"),
        runtime=runtime_of("lab_rehearse"),
    params:
        settings=stage_settings("lab_rehearse"),
        code=code_version("lab_rehearse"),
    message:
        "{wildcards.experiment}: the lab plays the first motion with an empty clamp"
    shell:
        "NUMBA_NUM_THREADS={threads} strandcast stage lab-rehearse {wildcards.experiment:q} 2>&1 | tee {log:q} >&2"


rule lab_throw:
    input:
        unpack(stage_inputs("lab_throw")),
    output:
        **kept(stage_outputs("lab_throw")),
    log:
        "results/{experiment}/trial-{trial}/logs/lab_throw.log",
    wildcard_constraints:
        experiment=FILMED_IN_LAB,
    group:
        shard_of("lab_throw")
    resources:
        mem_mb=memory_of("lab_throw"),
        runtime=runtime_of("lab_throw"),
    params:
        settings=stage_settings("lab_throw"),
        code=code_version("lab_throw"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the lab plays the motion and films the throw"
    shell:
        "strandcast stage lab-throw {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"


rule lab_capture:
    input:
        unpack(stage_inputs("lab_capture")),
    output:
        **kept(stage_outputs("lab_capture")),
    log:
        "results/{experiment}/trial-{trial}/logs/lab_capture.log",
    wildcard_constraints:
        experiment=CAPTURED_IN_LAB,
    group:
        shard_of("lab_capture")
    resources:
        mem_mb=memory_of("lab_capture"),
        runtime=runtime_of("lab_capture"),
    params:
        settings=stage_settings("lab_capture"),
        code=code_version("lab_capture"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the lab plays the motion and captures the throw"
    shell:
        "strandcast stage lab-capture {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
