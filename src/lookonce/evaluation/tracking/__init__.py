"""How good tracks are: CLEAR, identity and HOTA figures as TrackEval has them, and UA-DETRAC's own protocol."""
