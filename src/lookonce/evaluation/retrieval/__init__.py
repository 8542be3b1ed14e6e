"""How well descriptors tell objects apart, without a tracker: pairs of boxes, their distances, who is nearest."""
