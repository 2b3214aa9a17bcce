"""The figures and tables of the paper's page."""
