"""Probabilities of every explanation: nothing missing, one effect, two effects, something not in the list."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.inference.levels import PRIOR_NONE, PRIOR_OUTSIDE, PRIOR_PAIRS, PRIOR_REMAINDER
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem

NONE, OUTSIDE = "none", "outside_library"


@dataclass(frozen=True)
class Hypothesis:
    """One explanation and its evidence at every noise factor."""

    names: tuple[str, ...]
    outside: bool  # a smooth discrepancy acts too
    log_prior: float
    log_evidence: Floats
    told: bool = True  # its probability speaks for its names; else for something that is not in the list


@dataclass(frozen=True)
class Posterior:
    """Probabilities, summing to 1 over exclusive explanations."""

    probability: Mapping[str, float]  # "none", "outside_library", effect, "a+b"
    inclusion: Mapping[str, float]  # effect -> probability that it acts at all
    log_bayes: Mapping[str, float]  # effect -> ln evidence over the base
    noise_weight: Floats  # of every noise factor


def label(names: tuple[str, ...]) -> str:
    """How a set of effects is called in the table of probabilities."""
    return "+".join(names) if names else NONE


def log_prior_of(names: tuple[str, ...], outside: bool, count: int) -> float:
    """Ln prior of an explanation among `count` candidates."""
    pairs = count * (count - 1) // 2
    share_pairs = PRIOR_PAIRS if pairs else 0.0
    singles = 1.0 - PRIOR_NONE - PRIOR_OUTSIDE - share_pairs
    if not names:
        return float(np.log(PRIOR_OUTSIDE if outside else PRIOR_NONE))
    if len(names) == 1:
        return float(np.log(singles / count * (PRIOR_REMAINDER if outside else 1.0 - PRIOR_REMAINDER)))
    return float(np.log(share_pairs / pairs))


def posterior(prepared: PreparedProblem, hypotheses: list[Hypothesis]) -> Posterior:
    """Probabilities over all hypotheses, noise factors averaged."""
    doubt = prepared.doubt.log_weight
    joint = np.array([h.log_prior + doubt + h.log_evidence for h in hypotheses])
    joint -= log_sum_exp(joint)
    weight = np.exp(joint)
    each = weight.sum(axis=1)
    probability: dict[str, float] = {NONE: 0.0, OUTSIDE: 0.0}
    inclusion = {candidate.name: 0.0 for candidate in prepared.problem.candidates}
    probability |= inclusion
    for hypothesis, share in zip(hypotheses, each, strict=True):
        key = label(hypothesis.names) if hypothesis.told else OUTSIDE
        probability[key] = probability.get(key, 0.0) + float(share)
        for name in hypothesis.names if hypothesis.told else ():
            inclusion[name] += float(share)
    return Posterior(probability, inclusion, bayes_factors(prepared, hypotheses), weight.sum(axis=0))


def bayes_factors(prepared: PreparedProblem, hypotheses: list[Hypothesis]) -> dict[str, float]:
    """Ln of every single effect's evidence over the base, without and with a remainder at prior weights."""
    doubt = prepared.doubt.log_weight
    alone = {h.names: log_sum_exp(doubt + h.log_evidence) for h in hypotheses if not h.outside}
    return {names[0]: float(value - alone[()]) for names, value in alone.items() if len(names) == 1}
