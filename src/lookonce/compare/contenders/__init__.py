"""The trackers that are compared: each a function from all detections of a sequence to an id for every row."""
