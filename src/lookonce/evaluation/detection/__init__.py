"""How good a detector's boxes are: average precision as COCO computes it, and the curve behind it."""
