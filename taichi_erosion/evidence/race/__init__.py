"""One race: everything that could explain a misfit competes at once, and one rule decides.

The model of n rows on the comparison scale, whitened by their stated errors:

    y = J (v' - v) + sum_b tau_b F_b u_b + f e,      v', u_b, e ~ N(0, 1)

v' are calibrated numbers and strengths in standard coordinates, J the slopes of the model about its best
setting. The blocks F_b are errors that rows have in common: a level of each observable, sources,
preparations, numbers of each soil and a small smooth discrepancy; tau_b is half-Cauchy or half-normal, so
that most are near zero. f is the scatter over what is stated; a row may be bad. Every hypothesis has all.

    hypothesis                                  what acts beside the blocks             prior
    nothing                                     -                                       nothing
    a set of 1 to MOST listed effects           their strengths, among v'               step for one more
    a mechanism                                 a dose for every set of conditions      unlisted, step
    what no list holds                          a large smooth discrepancy, along one   unlisted, step
                                                condition or all

The evidence of each is the integral over everything unknown: exact over v', u and e, by Laplace's method over
tau and f. What is said has SURE of the probability of all hypotheses together, and no rows refute it.

    priors             every number of the inference, with its reason
    linear_evidence    evidence and posterior of linear rows
    blocks             the blocks
    expansion          standard coordinates, the model and its slopes
    fit, search        the best setting of one hypothesis; which of them are visited
    doses, dose_laws   mechanisms, and the law that their doses follow (forms: mechanisms/dose_forms)
    posterior          the race of a study; probabilities and draws, averaged over hypotheses
    decision           the one rule, and whether a name is better than chance makes it
    outlook            rows that the race has not seen: predictions, held-out rows
    proposals          measurements that would move the posterior
    adequacy           whether rows refute an explanation
"""
