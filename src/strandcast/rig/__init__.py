"""What the files of an arm state wrongly: links, clamp, zeros and the markers on the hand."""
