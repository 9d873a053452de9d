"""Prototypes: k-means in PCA space, the real frame nearest to each centre (Fu 2011, 3.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import KMeans

Float = NDArray[np.float32]


def choose_prototypes(coefficients: Float, count: int, *, seed: int) -> list[int]:
    """Frame numbers of `count` prototypes, in order of time.

    Args:
        coefficients: (T, K) PCA coefficients of the frames.
        count: N, 46 in Fu 2011; fewer if there are fewer frames.
        seed: of the start of k-means.
    """
    count = min(count, len(coefficients))
    centres = KMeans(count, n_init=4, random_state=seed).fit(coefficients).cluster_centers_
    distance = ((coefficients[:, None] - centres[None]) ** 2).sum(-1)
    return sorted({int(nearest) for nearest in distance.argmin(0)})


def choose_reference(coefficients: Float, prototypes: list[int], rest: int) -> int:
    """The prototype that looks least like the mouth at rest: the widest open one.

    Textures are kept on the reference's grid. A slit would sample teeth and tongue at the slit's resolution; the
    widest mouth shows all that any frame will need (Fu 2011 calls the choice arbitrary).
    """
    far = ((coefficients[prototypes] - coefficients[rest]) ** 2).sum(-1)
    return prototypes[int(far.argmax())]
