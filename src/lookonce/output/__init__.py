"""Sinks: results written frame by frame, valid whenever they are cut off."""
