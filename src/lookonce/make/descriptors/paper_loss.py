"""What trains the head of kind ``paper``: one classifier for all grids (figure 4) and the loss of equation (1).

The paper trains on whole maps and lets anchors without an object count for nothing. So does training on rows, one for
each object, where empty anchors do not appear at all: loss and gradients are the same.
"""

from __future__ import annotations

from torch import Tensor, nn

from lookonce.make.descriptors.head import DESCRIPTOR_SIZE

__all__ = ["PaperClassifier", "paper_loss"]


class PaperClassifier(nn.Module):
    """A three-dimensional convolution, 1 x 1 x 1, from descriptors to identities, then softmax over the identities.

    All grids share it, so an object must get near descriptors on each. It is left out of the model file.

    Args:
        identities: how many objects the training set tells apart.
    """

    def __init__(self, identities: int) -> None:
        super().__init__()
        self.convolution = nn.Conv3d(DESCRIPTOR_SIZE, identities, 1)

    def forward(self, descriptors: Tensor) -> Tensor:
        """Rows (N, 128) -> probabilities (N, identities)."""
        weight = self.convolution.weight.flatten(1)
        return nn.functional.linear(descriptors, weight, self.convolution.bias).softmax(dim=1)

    def forward_map(self, descriptors: Tensor) -> Tensor:
        """Whole maps (B, 128, anchors, rows, columns) -> (B, identities, anchors, rows, columns)."""
        logits: Tensor = self.convolution(descriptors)
        return logits.softmax(dim=1)


def paper_loss(probabilities: Tensor, labels: Tensor) -> Tensor:
    """Squared error, each anchor's sum multiplied by the sum of its label row. Implements eq. (1).

    Args:
        probabilities: (cells, anchors, identities) or rows (N, identities), float32 in [0, 1].
        labels: of the same shape; 1 at the object's identity, a row of zeros where there is no object.

    Returns:
        The sum over all anchors and cells, a scalar; 0 without rows.

    Raises:
        ValueError: the shapes differ.
    """
    if probabilities.shape != labels.shape:
        raise ValueError(f"labels: expected {tuple(probabilities.shape)}, got {tuple(labels.shape)}")
    error = (labels - probabilities).square().sum(dim=-1)
    return (error * labels.sum(dim=-1)).sum()
