"""The paper's experiment: what its runs come to. `strandcast paper` writes the runs down and makes them first.

REQUIRED INPUTS: the finished runs: results/<paper or paper-quick>-string*/
OUTPUTS:         results/<run>/transfer.json, results/<paper or paper-quick>/{summary.json, report.html}
STEPS:           transfer (a run's last throw under the fits at the string's other targets), paper (the whole)
"""

from strandcast.paper.cases import QUICK, WHOLE
from strandcast.paper.gather import last_of, same_string, states, summaries, transfers

THROWN = ["track.parquet", "alignment.json", "hand.parquet", "verdict.json"]


rule transfer:
    input:
        throw=lambda w: last_of(ROOT, [w.experiment], *THROWN),
        fits=lambda w: last_of(
            ROOT, same_string(ROOT, w.experiment), "ensemble.parquet"
        ),
        arm=arm_files,
    output:
        transfer="results/{experiment}/transfer.json",
    log:
        "results/{experiment}/logs/transfer.log",
    benchmark:
        "results/{experiment}/logs/transfer.jsonl"
    wildcard_constraints:
        experiment=rf"({WHOLE}|{QUICK})-string[a-z0-9-]+",
    params:
        fitted=lambda w: same_string(ROOT, w.experiment),
        settings=stage_settings("transfer"),
        code=code_version("transfer"),
    message:
        "{wildcards.experiment}: its throw under the fits at other targets"
    shell:
        "python -m strandcast transfer {wildcards.experiment:q} {params.fitted:q} 2>&1 | tee {log:q} >&2"


rule paper:
    input:
        plan="config/paper.yaml",
        summaries=lambda w: summaries(ROOT, w.form),
        transfers=lambda w: transfers(ROOT, w.form),
        budget=sorted(ROOT.glob("results/error-budget.json")),
    output:
        page="results/{form}/report.html",
        summary="results/{form}/summary.json",
    log:
        "results/{form}/logs/paper.log",
    wildcard_constraints:
        form=f"{WHOLE}|{QUICK}",
    params:
        states=lambda w: states(ROOT, w.form),
        code=code_version("paper_page"),
    message:
        "{wildcards.form}: the page of the paper's experiment is written"
    shell:
        "python -m strandcast paper-page {wildcards.form:q} 2>&1 | tee {log:q} >&2"
