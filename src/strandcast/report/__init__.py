"""Pages for people: one per trial, one per experiment, made from results alone."""
