"""The virtual rig, for experiments without a robot.

REQUIRED INPUTS: results/<experiment>/trial-NN/motion.json
OUTPUTS:         data/<experiment>/calibration/*, data/<experiment>/trial-NN/{video.mp4, joints.csv, run.json, motion.json}
STEPS:           setup (calibration photos), throw (play the motion, film it)
"""


rule setup:
    input:
        arm=arm_files,
    output:
        photos=[
            f"data/{{experiment}}/calibration/lens-{number:02d}.png"
            for number in range(1, 13)
        ],
        plane="data/{experiment}/calibration/plane.png",
    log:
        "results/{experiment}/logs/setup.log",
    benchmark:
        "results/{experiment}/logs/setup.jsonl"
    wildcard_constraints:
        experiment=LAB_EXPERIMENTS,
    params:
        settings=stage_settings("setup"),
        code=code_version("setup"),
    message:
        "{wildcards.experiment}: the lab photographs its calibration boards"
    shell:
        "python -m strandcast setup {wildcards.experiment:q} 2>&1 | tee {log:q} >&2"


rule throw:
    input:
        motion="results/{experiment}/trial-{trial}/motion.json",
        plane="data/{experiment}/calibration/plane.png",
        arm=arm_files,
    output:
        video="data/{experiment}/trial-{trial}/video.mp4",
        joints="data/{experiment}/trial-{trial}/joints.csv",
        run="data/{experiment}/trial-{trial}/run.json",
        motion="data/{experiment}/trial-{trial}/motion.json",
        truth="results/{experiment}/trial-{trial}/lab_truth.parquet",
    log:
        "results/{experiment}/trial-{trial}/logs/throw.log",
    benchmark:
        "results/{experiment}/trial-{trial}/logs/throw.jsonl"
    wildcard_constraints:
        experiment=LAB_EXPERIMENTS,
    params:
        settings=stage_settings("throw"),
        code=code_version("throw"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the lab plays the motion and films the throw"
    shell:
        "python -m strandcast throw {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
