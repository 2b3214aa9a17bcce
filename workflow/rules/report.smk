"""Pages, from results only.

REQUIRED INPUTS: everything that the stages made for a trial, and the next motion
OUTPUTS:         results/<experiment>/trial-NN/report.html, results/<experiment>/{report.html, summary.json}
"""


rule report_trial:
    input:
        results=trial_results,
        previous=lambda w: results_of(w.experiment, earlier(w)[-1:], *TRIAL_FILES),
    output:
        page="results/{experiment}/trial-{trial}/report.html",
    log:
        "results/{experiment}/trial-{trial}/logs/report.log",
    benchmark:
        "results/{experiment}/trial-{trial}/logs/report.jsonl"
    params:
        settings=stage_settings("report"),
        code=code_version("report"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the page is written"
    shell:
        "python -m strandcast report {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"


rule report_experiment:
    input:
        motion=first_motion,
        pages=lambda w: results_of(w.experiment, trials(w.experiment), "report.html"),
        results=lambda w: results_of(
            w.experiment,
            counted(w.experiment, trials(w.experiment)),
            "verdict.json",
            "estimate.json",
            "track.json",
            "alignment.json",
            "hand.parquet",
        ),
    output:
        page="results/{experiment}/report.html",
        summary="results/{experiment}/summary.json",
    log:
        "results/{experiment}/logs/summary.log",
    benchmark:
        "results/{experiment}/logs/summary.jsonl"
    params:
        trials=lambda w: trials(w.experiment),
        settings=stage_settings("summary"),
        code=code_version("summary"),
    message:
        "{wildcards.experiment}: the experiment's page and summary are written"
    shell:
        "python -m strandcast summary {wildcards.experiment:q} {params.trials} 2>&1 | tee {log:q} >&2"
