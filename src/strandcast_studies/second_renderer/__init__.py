"""Films by a renderer that shares nothing with the lab's, to see if the stated error of a miss holds."""
