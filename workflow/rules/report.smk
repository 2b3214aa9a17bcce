"""Pages, from results only.

REQUIRED INPUTS: all results of a trial and of the one before, the next motion, the arm's file
OUTPUTS:         results/<experiment>/trial-NN/report.html, results/<experiment>/{report.html, summary.json}
EXIT CODE 4:     the page was made, and says which results could not be read: its job has not failed
"""


rule report_trial:
    input:
        unpack(stage_inputs("report")),
    output:
        **stage_outputs("report"),
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
        " || [ $? -eq 4 ]"


rule report_experiment:
    input:
        unpack(stage_inputs("summary", all_trials)),
    output:
        **stage_outputs("summary"),
    log:
        "results/{experiment}/logs/summary.log",
    benchmark:
        "results/{experiment}/logs/summary.jsonl"
    params:
        trials=all_trials,
        settings=stage_settings("summary"),
        code=code_version("summary"),
    message:
        "{wildcards.experiment}: the experiment's page and summary are written"
    shell:
        "python -m strandcast summary {wildcards.experiment:q} {params.trials} 2>&1 | tee {log:q} >&2"
        " || [ $? -eq 4 ]"
