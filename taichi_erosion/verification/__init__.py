"""Do we solve the equations right? A ladder of claims, each with what was got, what is wanted and how far
it may be off.
"""

from taichi_erosion.verification.claim import Claim
from taichi_erosion.verification.ladder import LADDER, verify

__all__ = ["LADDER", "Claim", "verify"]
