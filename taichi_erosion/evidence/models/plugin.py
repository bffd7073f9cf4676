"""Model function of the user, `module:function`, beside the study file or in an installed package.

With it what stands around it: the adapter that maps the study's column and observable names to the model's,
and effects of the user's own files. A model function has its own effects inside; two kinds of files can be
added to it: effects of the place `instrument`, which change readings, and laws of a mechanism that the
function declares, which give it the dose of that mechanism row by row. Any other place acts within a
simulation, which a function hides.
"""

import contextlib
import importlib.util
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from math import isfinite
from pathlib import Path
from types import ModuleType

import numpy as np
from scipy import linalg

from taichi_erosion.core.effect import Effect
from taichi_erosion.core.effect_file import EffectFile, announce_file, effect_in, failures_of, require_number
from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.evidence.data.problem import (
    Conditions,
    Floats,
    Integers,
    Mechanism,
    Model,
    Numbers,
    QueryRows,
    row_count,
)
from taichi_erosion.evidence.data.transforms import slope
from taichi_erosion.mechanisms.library import mechanism_rows

COVARIANCE = "_covariance"  # after a function's name: the function that gives the covariance of its errors
MECHANISMS = "_mechanisms"  # after a function's name: mechanism -> least and largest dose of the function
READ = "READS"  # of a module: the files beside it that it reads
OURS = __name__.partition(".")[0]  # package whose modules are nobody else's code

Covariance = Callable[[str, Conditions, Numbers, Numbers], Floats]


@dataclass(frozen=True)
class Plugin:
    """A model function, with its result checked at every call."""

    name: str
    function: Model
    version: str  # digest of the files beside it: an edited model has no earlier runs
    covariance: Covariance | None = None  # of the model's own errors over rows; None: without error
    mechanisms: tuple[Mechanism, ...] = ()  # places in which something can be missing

    def __call__(
        self, observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
    ) -> Floats:
        """Predictions [seed, row]; raises SimulationStopped where the function fails."""
        at = {name: column.copy() for name, column in conditions.items()}  # which it may write to
        with report_model_failure(self.name, observable):
            values = self.function(observable, at, parameters, effects, seeds)
        shape = (len(seeds), row_count(conditions))
        return check_model_result(values, shape, "(seeds, conditions)", f"model {self.name}, {observable}")

    def model_error_covariance(
        self, observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers
    ) -> Floats:
        """Covariance of the model's own errors [row, row], in the unit of the observable squared."""
        assert self.covariance is not None
        at = {name: column.copy() for name, column in conditions.items()}
        with report_model_failure(self.name + COVARIANCE, observable):
            covariance = self.covariance(observable, at, parameters, effects)
        rows = row_count(conditions)
        where = f"model {self.name}{COVARIANCE}, {observable}"
        return check_model_result(covariance, (rows, rows), "(conditions, conditions)", where)


@contextlib.contextmanager
def report_model_failure(name: str, observable: str) -> Iterator[None]:
    """An error in a user's function becomes SimulationStopped with the function's name."""
    try:
        with contextlib.redirect_stdout(sys.stderr):  # stdout holds the result and nothing else
            yield
    except KeyError as error:
        sections = "[candidates], [conditions] and [parameters]"
        raise BadInput(f"model {name} reads {error}, which {sections} of the study lack") from error
    except Exception as error:
        kind = type(error).__name__
        raise SimulationStopped(f"model {name} failed on {observable}: {kind}: {error}") from error


def check_model_result(result: object, shape: tuple[int, int], axes: str, where: str) -> Floats:
    """Result of a model function as an array of the promised shape; raises BadInput."""
    try:
        values = np.asarray(result, dtype=np.float64)
    except (TypeError, ValueError):
        raise BadInput(f"{where}: returned {type(result).__name__}; an array of numbers is needed") from None
    if values.shape != shape:
        raise BadInput(f"{where}: returned shape {values.shape}; {shape} is needed: {axes}")
    return np.where(np.isfinite(values), values, np.nan)


def load_plugin(name: str, folder: Path, file: str) -> Plugin:
    module_name, _, function_name = name.partition(":")
    where = f"{file}: study.model = '{name}'"
    module = load_model_module(module_name, folder, file, where)
    function = getattr(module, function_name, None)
    if not callable(function):
        raise BadInput(f"{where}: {module_name} has no function {function_name}")
    covariance = getattr(module, function_name + COVARIANCE, None)
    places = declared_mechanisms(getattr(module, function_name + MECHANISMS, {}), where + MECHANISMS)
    return Plugin(name, function, code_digest(module, where), covariance, places)  # pyright: ignore[reportArgumentType]


def declared_mechanisms(declaration: object, where: str) -> tuple[Mechanism, ...]:
    """Mechanisms of a model function with their doses. Raises BadInput."""
    library = mechanism_rows()
    if not isinstance(declaration, Mapping):
        raise BadInput(f"{where}: is not a table from mechanism to (least, largest) dose")
    for name, ends in declaration.items():
        if name not in library:
            raise BadInput(f"{where}: '{name}' is no mechanism; `effects --mechanisms` lists them")
        if not (isinstance(ends, Sequence) and len(ends) == 2 and ends[0] <= 0.0 < ends[1]):
            raise BadInput(f"{where}: {name} = {ends!r}; least and largest dose are needed, 0 among them")
    return tuple(Mechanism(name, float(low), float(high)) for name, (low, high) in declaration.items())


def load_model_module(name: str, folder: Path, study: str, where: str) -> ModuleType:
    """Module beside the study file, else an installed one; its neighbours can be imported by it."""
    sibling = folder.joinpath(*name.split(".")).with_suffix(".py")
    package = name.partition(".")[0]
    sys.path.insert(0, str(folder.resolve()))
    try:
        with contextlib.redirect_stdout(sys.stderr):
            if sibling.is_file():
                announce_file(sibling, study)
                return execute_module_file(name, sibling)
            spec = importlib.util.find_spec(package)
            if spec is not None and spec.origin is not None and package != OURS:
                announce_file(Path(spec.origin), study)
            return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name and name.startswith(error.name):
            raise BadInput(f"{where}: no file {sibling} and no installed package of that name") from None
        raise BadInput(f"{where}: cannot be imported: {error}") from None
    except Exception as error:
        raise BadInput(f"{where}: cannot be imported: {type(error).__name__}: {error}") from None
    finally:
        sys.path.remove(str(folder.resolve()))


def execute_module_file(name: str, file: Path) -> ModuleType:
    """Module of one file, executed afresh: two studies may each have a file of that name."""
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and pickles look their module up by name
    spec.loader.exec_module(module)
    return module


def code_digest(module: ModuleType, where: str) -> str:
    """Digest of all Python files in the folder of a module, and of the files in its list READS."""
    file = getattr(module, "__file__", None)
    if not file:
        return sha256().hexdigest()[:16]
    folder, digest = Path(file).parent, sha256()
    read = [folder / name for name in getattr(module, READ, ())]
    for source in [*sorted(folder.glob("*.py")), *read]:
        if not source.is_file():
            raise BadInput(f"{where}: {READ} names {source}: no such file")
        digest.update(source.name.encode() + source.read_bytes())
    return digest.hexdigest()[:16]


@dataclass(frozen=True)
class NameMapping:
    """Adapter that maps the study's names to the model's; conditions that no row states are left out."""

    model: Model | None  # None: scenes, until an emulator stands for them
    names: dict[str, str]  # column -> what the model calls it
    observables: dict[str, str]  # likewise

    def __call__(
        self, observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
    ) -> Floats:
        """Predictions [seed, row]."""
        assert self.model is not None
        at = self.model_conditions(conditions)
        return self.model(self.observables[observable], at, parameters, effects, seeds)

    def model_conditions(self, conditions: Conditions) -> Conditions:
        """Conditions that any row states, by the names of the model."""
        return {self.names[c]: v for c, v in conditions.items() if not bool(np.isnan(v).all())}


@dataclass(frozen=True)
class ModelErrorCovariance:
    """Covariance of the errors that a model function states of itself, on the comparison scale."""

    plugin: Plugin
    mapped: NameMapping
    seed: int  # of the value at which the scale is taken

    def __call__(self, queries: Sequence[QueryRows], parameters: Numbers, effects: Numbers) -> Floats:
        """Covariance [row, row]; those of two observables are apart, and a dose changes none."""
        parts = []
        for observable, conditions, _ in queries:
            name, at = self.mapped.observables[observable.name], self.mapped.model_conditions(conditions)
            value = self.mapped(observable.name, conditions, parameters, effects, np.array([self.seed]))[0]
            steepness = slope(observable, value)
            covariance = self.plugin.model_error_covariance(name, at, parameters, effects)
            parts.append(covariance * np.outer(steepness, steepness))
        return np.asarray(linalg.block_diag(*parts), dtype=np.float64)


def dose_of_rows(law: Effect, conditions: Conditions) -> Floats:
    params, doses = law.params(), np.zeros(row_count(conditions))
    with failures_of(law, "dose"):
        for row in range(doses.size):
            doses[row] = law.dose(params, stated_conditions_of_row(conditions, row))
    return doses


def apply_instrument_effect(
    effect: Effect, strength: float, conditions: Conditions, observable: str, values: Floats
) -> Floats:
    """Values [seed, row] as one instrument shows them."""
    params, read = effect.params(), values.copy()
    with failures_of(effect, "act"):
        for seed, row in np.ndindex(values.shape):
            at, value = stated_conditions_of_row(conditions, row), float(values[seed, row])
            read[seed, row] = require_number(effect, effect.act(params, strength, at, observable, value))
    return read


def stated_conditions_of_row(conditions: Conditions, row: int) -> Numbers:
    return {name: float(column[row]) for name, column in conditions.items() if isfinite(column[row])}


def load_function_effects(
    path: Path, files: tuple[EffectFile, ...], mechanisms: tuple[Mechanism, ...]
) -> dict[str, Effect]:
    """Effects of some files by name. Raises BadInput for one that a model function cannot take."""
    effects: dict[str, Effect] = {}
    places = {mechanism.name for mechanism in mechanisms}
    for file in files:
        effect = effect_in(file)
        if effect.place != "instrument" and effect.mechanism not in places:
            place = f"place '{effect.place}', which acts inside a simulation"
            able = "effects of place 'instrument', and laws of the mechanisms that its function declares"
            words = f"has {place}; a study with model = ... takes {able}"
            raise BadInput(f"{path}: effect '{effect.name}' of {file} {words}")
        if effect.name in effects:
            raise BadInput(f"{file}: effect '{effect.name}' exists already in another file")
        effects[effect.name] = effect
    return effects
