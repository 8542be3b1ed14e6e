"""A tracker's settings searched on labelled sequences: detections are found once, then every trial only associates."""
