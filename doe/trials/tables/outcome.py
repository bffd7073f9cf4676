"""What an answer to a table is worth, and its shares beside what is wanted.

Wrong is a name or a group of which none acts, "agrees with all rows" where a strong effect acts, and "not in
the list" for listed effects of constant strength alone.
"""

from collections.abc import Iterator

from doe.trials.metrics import STRONG, Case, Cases, Metric, share
from doe.trials.tables.solve import SIGNIFICANT

KINDS = ("null", "listed", "pair", "varying", "outside")
WORDS = ("right", "part", "silent", "alarm", "wrong", "refused")
APART = 3.0  # sd from the nearest listed effect, from which a law can be told from it
HOLDS = 0.5  # share of the misfit of left-out rows that a law explains


def has_no_answer(case: Case) -> bool:
    """Whether the table is refused, for whatever reason."""
    return bool(case.answer["refused"] or case.answer["refused_scatter"])


def refuses_heading(case: Case) -> bool:
    """Whether the table is refused at first, without one of the reasons for which it should be."""
    first = case.answer["refused_first"]
    expected = first.startswith(("--", "Usage")) or "the scatter is unknown" in first
    return bool(first) and not expected and not case.truth["may_refuse"]


def tells_unlisted(case: Case) -> bool:
    """Told as not in the list, or by a law that holds at left-out rows."""
    law = case.answer["law"] and (case.answer["held_out_share"] or 0.0) >= HOLDS
    return case.flagged or bool(law and not case.told)


def names_falsely(case: Case) -> bool:
    """Names or a group are told, of which none acts."""
    return bool(case.told) and not case.told & case.acting


def wrong(case: Case) -> bool:
    """Whether an answer is wrong."""
    unlisted, agrees = tells_unlisted(case), bool(case.answer["agrees"])
    silent = agrees and not case.told and not unlisted
    listed = unlisted and not case.told and case.truth["kind"] in ("listed", "pair")
    return names_falsely(case) or listed or (silent and case.ratio >= STRONG)


def word(case: Case) -> str:
    """One of WORDS."""
    kind, unlisted = case.truth["kind"], tells_unlisted(case)
    if has_no_answer(case):
        return "right" if case.truth["unknown_scatter"] and not case.answer["refused"] else "refused"
    if wrong(case):
        return "wrong"
    if kind == "null":
        return "alarm" if unlisted else "right" if case.answer["agrees"] else "silent"
    if case.exact or (unlisted and kind in ("varying", "outside")):
        return "right"
    return "part" if case.told else "silent"


def excludes_falsely(case: Case) -> bool:
    """Whether an effect that acts is said to be excluded above less than its strength."""
    limits = case.answer["excluded"]
    return any(limits.get(name, size) < size for name, size in case.truth["effects"].items())


def line(case: Case) -> str:
    """The case on one line."""
    truth, answer, law = case.truth, case.answer, case.truth["outside"]
    acts = ", ".join(f"{name} {size:.2g}" for name, size in truth["effects"].items())
    acts = f"{law['form']} of {law['axes'][0]}" if law else acts
    refusal = (answer["refused"] or answer["refused_scatter"])[:70]
    names = "+".join(answer["named"]) + f" ({'/'.join(answer['group'])})" * bool(answer["group"])
    told = f"refused: {refusal}" if refusal else f"{answer['verdict']} {names}" + " agrees" * answer["agrees"]
    marks = [word(case), *(f"misread {kind}" for kind in case.row["misread"])]
    marks += [f"misread and told {kind}" for kind in answer["told_misread"]]
    marks += [f"refused at first: {answer['refused_first'][:90]}"] * refuses_heading(case)
    table = f"{truth['layout']} {'+'.join(truth['observables'])}{' soils' * (truth['soils'] > 1)}"
    table += f" <{truth['below']}" * bool(truth["below"])
    acts = f"{case.row['case']:4} {table} | {truth['kind']} {acts} [{case.ratio:.1f}]"
    return f"{acts} -> {told} | {'; '.join(marks)}"


def table_metrics(cases: Cases) -> Iterator[Metric]:
    """Lines of what is wanted, then what became of every kind of truth."""
    yield share("misread in silence", [bool(c.row["misread"]) for c in cases], "<= 0.013")
    yield share("misread, and told", [bool(c.answer.get("told_misread")) for c in cases])
    for kind in sorted({kind for c in cases for kind in c.row["misread"]}):
        yield share(f"misread: {kind}", [kind in c.row["misread"] for c in cases])
    unknown = [has_no_answer(c) for c in cases if c.truth["unknown_scatter"]]
    yield share("unknown scatter refused", unknown, ">= 0.9")
    yield share("ordinary headings refused at first", [refuses_heading(c) for c in cases], "<= 0.03")
    known = [c for c in cases if not c.truth["unknown_scatter"]]
    yield share("known scatter: no answer", [has_no_answer(c) for c in known])
    stated = [has_no_answer(c) for c in known if {"--sd", "--diameter"} & {*c.truth["options"]["table"]}]
    yield share("the same, sd or diameter stated by an option", stated)
    found = [c for c in known if not has_no_answer(c)]
    yield from strong_metrics(found)
    tested = [c.answer["p_lack_of_fit"] for c in found if c.answer["agrees"]]
    lack = [p < SIGNIFICANT for p in tested if p is not None]
    yield share("agrees, beside a lack of fit p < 0.01", lack, "<= 0.05")
    yield share("a true effect excluded", [excludes_falsely(c) for c in found if c.acting], "<= 0.01")
    below = [excludes_falsely(c) for c in found if c.acting and c.truth["below"]]
    yield share("the same, rows below a limit", below)
    named = [c.answer["adopted"] for c in found if c.named and c.answer["adopted"]]
    yield share("named, then refused by adopt", [not each["improves"] for each in named], "<= 0.02")
    yield share("named, and what is left is no chance", [not each["holds"] for each in named])
    for kind in KINDS:
        own = [word(c) for c in found if c.truth["kind"] == kind]
        for each in (each for each in WORDS if each in own):
            yield share(f"{kind}: {each}", [each == other for other in own])


def strong_metrics(cases: Cases) -> Iterator[Metric]:
    """What is told of null, outside laws, strong listed effects, and those of varying strength."""
    by_kind = {kind: [c for c in cases if c.truth["kind"] == kind] for kind in KINDS}
    yield share("nothing missing: a name or group", [bool(c.told) for c in by_kind["null"]], "<= 0.02")
    yield share("nothing missing: not in the list", [tells_unlisted(c) for c in by_kind["null"]])
    outside, text = by_kind["outside"], "the same, apart from every listed effect"
    apart = [c for c in outside if c.separation >= APART]
    yield share("outside the list: wrong", [wrong(c) for c in outside], "<= 0.05")
    yield share(text, [wrong(c) for c in apart])
    own = [tells_unlisted(c) for c in outside if c.ratio >= STRONG]
    yield share("strong outside laws: told as such, or by a law that holds", own, ">= 0.6")
    yield share(text, [tells_unlisted(c) for c in apart if c.ratio >= STRONG])
    listed = [c for c in (*by_kind["listed"], *by_kind["pair"]) if c.ratio >= STRONG]
    below, soils = [c for c in listed if c.truth["below"]], [c for c in listed if c.truth["soils"] > 1]
    parts = {
        "": (listed, ">= 0.7"),
        ", rows below a limit": (below, ">= 0.6"),
        ", two soils": (soils, ">= 0.6"),
    }
    for name, (own, wanted) in parts.items():
        yield share(f"strong listed effects{name}: all named", [word(c) == "right" for c in own], wanted)
        yield share(f"strong listed effects{name}: one told", [bool(c.told & c.acting) for c in own])
    varying = [c for c in by_kind["varying"] if c.ratio >= STRONG]
    yield share("varying, strong: named", [c.exact for c in varying])
    own = [bool({*c.answer["varying"]} & c.acting & c.told) for c in varying]
    yield share("varying, strong: told with a strength that varies", own)
    yield share("varying, strong: not in the list", [tells_unlisted(c) for c in varying])
    yield share("varying, strong: another name", [names_falsely(c) for c in varying])
