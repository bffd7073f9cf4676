"""Check of one effect against the contract, on a device that is started for it."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from taichi_erosion.core.device import start_device, stop_device
from taichi_erosion.core.effect import Check, Effect, Probe
from taichi_erosion.core.effect_loading import effect_in
from taichi_erosion.core.effect_probe import make_bench, probe_of
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.foreign_code import EffectFile, read_effect_files
from taichi_erosion.core.setup import Numerics
from taichi_erosion.verification.effect_contract import breaches, unusable


@dataclass(frozen=True)
class Examination:
    """What a check of one effect found."""

    table: tuple[Check, ...]  # verification table, as far as it can be computed
    unusable: str | None  # why it cannot act at all
    breaches: tuple[str, ...]  # everything in which it breaks the contract
    seconds: float  # that the check took


def examine(effect: Effect) -> Examination:
    """Check of one effect against the contract, on a device that is started for it and released."""
    started = perf_counter()
    start_device(Numerics(threads=1))
    bench = make_bench()
    try:
        reason = unusable(effect, bench)
        if reason is not None:
            return Examination((), reason, (reason,), perf_counter() - started)
        table, broken = lines_of_table(effect, probe_of(effect, bench)), breaches(effect, bench)
        return Examination(table, None, tuple(broken), perf_counter() - started)
    finally:
        stop_device()


def examined_file(file: EffectFile) -> dict[str, Any]:
    """Name, breaches and time [s] of the check of the effect of a file. Raises BadInput if it cannot act."""
    effect = effect_in(file)
    found = examine(effect)
    if found.unusable is not None:
        raise BadInput(f"{file}: effect '{effect.name}' cannot act: {found.unusable}")
    return {
        "effect": effect.name,
        "file": str(file),
        "breaches": list(found.breaches),
        "wall_s": found.seconds,
    }


def refuse_unusable(paths: Iterable[Path]) -> list[dict[str, Any]]:
    """Checks of effect files before a session. Raises BadInput where an effect cannot act."""
    return [examined_file(file) for file in read_effect_files(paths)]


def examined_words(found: Mapping[str, Any]) -> str:
    """One sentence on the check of a file."""
    told = f"effect '{found['effect']}' of {found['file']}"
    if not found["breaches"]:
        return f"{told} compiles and keeps the contract of effects (checked in {found['wall_s']:.1f} s)"
    first, more = found["breaches"][0], len(found["breaches"]) - 1
    others = (
        f" (and {more} more: `effects {found['effect']} --effect {found['file']}` lists them)" if more else ""
    )
    return f"{told} breaks the contract of effects: {first}{others}"


def lines_of_table(effect: Effect, probe: Probe) -> tuple[Check, ...]:
    """Verification table of an effect as far as it can be computed; the contract names what is missing."""
    lines = []
    with suppress(Exception):
        for check in effect.checks(probe):
            lines.append(check)
    return tuple(lines)
