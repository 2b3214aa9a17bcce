"""Lens and plane of motion.

REQUIRED INPUTS: data/<experiment>/calibration/{lens-*.png or a video, plane.png}
OUTPUTS:         results/<experiment>/{camera.json, camera.webp}
"""


rule calibrate:
    input:
        files=calibration_files,
    output:
        camera="results/{experiment}/camera.json",
        picture="results/{experiment}/camera.webp",
    log:
        "results/{experiment}/logs/calibrate.log",
    benchmark:
        "results/{experiment}/logs/calibrate.jsonl"
    params:
        settings=stage_settings("calibrate"),
        code=code_version("calibrate"),
    message:
        "{wildcards.experiment}: the lens and the plane of motion are calibrated"
    shell:
        "python -m strandcast calibrate {wildcards.experiment:q} 2>&1 | tee {log:q} >&2"
