"""The model file: open, check, run."""

from lookonce.model.metadata import DescriptorInfo, Feature, ModelMetadata
from lookonce.model.model import Model, describe_model

__all__ = ["DescriptorInfo", "Feature", "Model", "ModelMetadata", "describe_model"]
