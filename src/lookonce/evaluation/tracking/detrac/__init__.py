"""The protocol of UA-DETRAC: L. Wen et al., "UA-DETRAC: a new benchmark and protocol", CVIU 193 (2020)."""
