"""The model file: open, check, run."""

from lookonce.model.metadata import DescriptorInfo, Feature, ModelMetadata, OutputGrid
from lookonce.model.model import Model, describe_model
from lookonce.model.session import available_cpus

__all__ = ["DescriptorInfo", "Feature", "Model", "ModelMetadata", "OutputGrid", "available_cpus", "describe_model"]
