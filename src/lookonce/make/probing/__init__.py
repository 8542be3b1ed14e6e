"""Pictures of what descriptors see: whom they take for whom, and how far apart they put one object and two."""

from lookonce.make.probing.distances import draw_distances
from lookonce.make.probing.neighbours import Neighbourhood, ShownObject, draw_neighbours
from lookonce.make.probing.queries import choose_queries, nearest

__all__ = ["Neighbourhood", "ShownObject", "choose_queries", "draw_distances", "draw_neighbours", "nearest"]
