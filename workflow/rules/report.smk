"""Pages, from results only.

REQUIRED INPUTS: all results of a trial and of the one before, the next motion, the arm's file
OUTPUTS:         results/<experiment>/trial-NN/report.html, results/<experiment>/{report.html, summary.json},
                 results/report.html
EXIT CODE 4:     the page was made, and says which results could not be read: its job has not failed
"""


rule report_trial:
    input:
        unpack(stage_inputs("report")),
    output:
        **shown(stage_outputs("report"), "Trials", page="trial"),
    log:
        "results/{experiment}/trial-{trial}/logs/report.log",
    group:
        shard_of("report")
    resources:
        mem_mb=memory_of("report"),
        runtime=runtime_of("report"),
    params:
        settings=stage_settings("report"),
        code=code_version("report"),
    message:
        "{wildcards.experiment} trial {wildcards.trial}: the page is written"
    shell:
        "strandcast report {wildcards.experiment:q} {wildcards.trial} 2>&1 | tee {log:q} >&2"
        " || [ $? -eq 4 ]"


rule report_experiment:
    input:
        unpack(stage_inputs("summary", all_trials)),
    output:
        **shown(
            stage_outputs("summary"),
            "Experiments",
            page="experiment",
            summary="summary",
        ),
    log:
        "results/{experiment}/logs/summary.log",
    group:
        shard_of("summary")
    resources:
        mem_mb=memory_of("summary"),
        runtime=runtime_of("summary"),
    params:
        trials=all_trials,
        settings=stage_settings("summary"),
        code=code_version("summary"),
    message:
        "{wildcards.experiment}: the experiment's page and summary are written"
    shell:
        "strandcast stage summary {wildcards.experiment:q} {params.trials} 2>&1 | tee {log:q} >&2"
        " || [ $? -eq 4 ]"


rule report_campaign:
    input:
        expand("results/{experiment}/summary.json", experiment=EXPERIMENTS),
    output:
        page=report(
            "results/report.html",
            category="All experiments",
            labels={"content": "campaign"},
            caption="../report/campaign.rst",
        ),
    log:
        "results/campaign.log",
    params:
        code=code_version("strandcast.workflow.campaign"),
    message:
        "the page of all experiments is written"
    shell:
        "strandcast stage campaign 2>&1 | tee {log:q} >&2"
