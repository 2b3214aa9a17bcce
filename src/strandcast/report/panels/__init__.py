"""The panels of the pages: one function each, declared in lists, open to other packages."""
