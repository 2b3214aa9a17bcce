"""docs/errors.md, from the registry of error codes: `python -m strandcast_studies.errors_page`."""

from strandcast.errors.registry import read_codes

HEAD = """\
# Error codes

Every problem that strandcast reports has a code, which stands for what to do about it. The message says what
is wrong in this case: the file, the line or field, the offending value and what ignoring it would cost. Its
fix is the one below, or a more exact one. `strandcast explain CODE` prints an entry, also for a code of a
former version.

<!-- made by: python -m strandcast_studies.errors_page > docs/errors.md -->
"""


def errors_page() -> str:
    """Return docs/errors.md: one section per letter, one entry per code."""
    letters, codes = read_codes()
    parts = [HEAD]
    for letter, subject in letters.items():
        parts.append(f"\n## SC-{letter}: {subject}\n")
        for code in sorted(code for code in codes if code[3] == letter):
            entry = codes[code]
            cause = f"{entry.cause}\n\n" if entry.cause else ""
            parts.append(f"\n### {code}: {entry.title}\n\n{cause}**Fix:** {entry.fix}\n")
    return "".join(parts)


if __name__ == "__main__":
    print(errors_page(), end="")
