"""Principal components of maps. Caches, the page and Nuke's layers keep the strongest ones."""

import torch


def principal_components(maps: torch.Tensor, rank: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Factor maps (K, N) into their `rank` strongest components over the pixels.

    Returns a basis (K, rank) of orthonormal columns, the strongest first, and coefficients (rank, N),
    float32, such that `basis @ coefficients` is the best approximation. The maps of the 96 anchor directions
    are of low rank.

    >>> import torch
    >>> maps = torch.outer(torch.arange(4.0), torch.ones(6))
    >>> basis, coefficients = principal_components(maps, 1)
    >>> torch.allclose(basis @ coefficients, maps, atol=1e-5)
    True
    """
    basis = strongest(covariance(maps), rank)
    return basis, projected(basis, maps)


def covariance(maps: torch.Tensor) -> torch.Tensor:
    """Return the products (K, K), float64, of maps (K, N) with each other; those of several frames add up."""
    return (maps @ maps.T).double()


def strongest(products: torch.Tensor, rank: int) -> torch.Tensor:
    """Return the basis (K, rank) of the strongest components of maps with these products (K, K)."""
    _, vectors = torch.linalg.eigh(products)
    return vectors[:, -rank:].flip(1).float()


def projected(basis: torch.Tensor, maps: torch.Tensor) -> torch.Tensor:
    """Return the coefficients (rank, N) of maps (K, N) in an orthonormal basis (K, rank)."""
    return basis.T @ maps
