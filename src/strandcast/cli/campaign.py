"""The command that writes the page of all experiments: campaign."""

from strandcast.cli.common import ROOT, AsJson, show


def campaign(as_json: AsJson = False) -> None:
    """Write the page of all experiments, results/report.html, from their summaries."""
    from strandcast.workflow.campaign import write_campaign
    from strandcast.workflow.runner import refuse_elsewhere

    refuse_elsewhere(ROOT)
    tally, page = write_campaign(ROOT)
    show(as_json, tally.to_json() | {"page": page}, [f"{tally}; page: {page}"])
