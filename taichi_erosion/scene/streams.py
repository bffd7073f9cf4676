"""Random numbers of a scene: one independent stream for each seed and purpose."""

from hashlib import sha256

import numpy as np


def stream(seed: int, purpose: str) -> np.random.Generator:
    """Counter-based generator whose key is the seed and the purpose, so that no purpose disturbs another.

    Reference: Salmon et al. (2011), SC '11, article 16 (Philox).
    """
    digest = sha256(f"{seed}:{purpose}".encode()).digest()
    return np.random.Generator(np.random.Philox(key=np.frombuffer(digest[:16], dtype=np.uint64)))
