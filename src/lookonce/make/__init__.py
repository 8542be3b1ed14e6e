"""The torch half: reads detectors, trains, writes model files. Needs the extra ``train``."""
