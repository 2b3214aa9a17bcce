"""A virtual rig for sittings: an arm behind a socket, a camera that leaves films in a folder."""
