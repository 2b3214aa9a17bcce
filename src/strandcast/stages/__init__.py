"""The stages: each reads files, calls the rooms, writes files. A rule or a command calls one of them."""
