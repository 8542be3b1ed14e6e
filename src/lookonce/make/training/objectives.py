"""What training asks of descriptors."""

from __future__ import annotations

import torch
from torch import Tensor

__all__ = ["contrastive_loss"]

_NEVER = -1e9


def contrastive_loss(descriptors: Tensor, identity: Tensor, is_comparable: Tensor, temperature: float) -> Tensor:
    """Supervised contrastive loss: each row should be nearest to the other rows of its identity.

    Khosla et al. 2020, equation (2) (L_out), with pairs left out of which nobody knows whether they are one object.

    Args:
        descriptors: (N, D) of unit length.
        identity: (N,) int64.
        is_comparable: (N, N) bool, False for pairs to leave out.
        temperature: divides the cosines.

    Returns:
        Scalar; 0 where no identity has two rows.
    """
    itself = torch.eye(len(identity), dtype=torch.bool, device=identity.device)
    same = (identity[:, None] == identity[None, :]) & ~itself
    cosine = (descriptors @ descriptors.T / temperature).masked_fill(itself | ~(is_comparable | same), _NEVER)
    log_probability = cosine - torch.logsumexp(cosine, dim=1, keepdim=True)
    partners = same.sum(dim=1)
    sums = torch.where(same, log_probability, 0).sum(dim=1)
    has_partner = partners > 0
    if not has_partner.any():
        return descriptors.sum() * 0
    return -(sums[has_partner] / partners[has_partner]).mean()
