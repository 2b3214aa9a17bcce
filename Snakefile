# The front door: `snakemake --cores 2 results/demo/report.html`, from the project's root.
include: "workflow/Snakefile"


rule default:
    default_target: True
    input:
        rules.all.input,
