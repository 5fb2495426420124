"""What a configuration says, checked: algorithms chosen, pipelines made of them, and the settings of a run."""

from __future__ import annotations

import json
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Any, TypeVar

import msgspec

from tickfix.api.errors import ConfigError
from tickfix.config.checks import check_keys, convert
from tickfix.config.parameters import describe
from tickfix.config.words import one_of
from tickfix.kernel import KernelSettings
from tickfix.plugins import Offer

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Choice:
    """An algorithm that a pipeline chose, with its parameters checked."""

    offer: Offer
    params: Any
    preset: str = ""

    @property
    def key(self) -> str:
        """Equal for choices that compute the same."""
        return f"{self.offer.label} {json.dumps(msgspec.to_builtins(self.params), sort_keys=True)}"

    @property
    def model(self) -> str:
        """Name of the model trained for it: parameters that training does not depend on do not matter."""
        trains = {field.name: getattr(self.params, field.name) for field in describe(self.offer.cls) if field.trains}
        digest = sha256(json.dumps(msgspec.to_builtins(trains), sort_keys=True).encode()).hexdigest()[:12]
        return f"{self.offer.kind}-{self.offer.name}-{digest}"


@dataclass(frozen=True, slots=True)
class PipelineConfig:
    """A named choice of stages.

    Attributes:
        table: the name in the file, which several pipelines of a sweep share.
        swept: the parameters that vary within a sweep, with this pipeline's values.
    """

    name: str
    filter: Choice
    pdr: Choice | None = None
    fingerprint: Choice | None = None
    map: Choice | None = None
    table: str = ""
    swept: tuple[tuple[str, Any], ...] = ()

    @property
    def choices(self) -> tuple[Choice, ...]:
        """The stages that are there."""
        return tuple(c for c in (self.pdr, self.fingerprint, self.filter, self.map) if c is not None)


@dataclass(frozen=True, slots=True)
class Config:
    """Everything a configuration file says.

    Attributes:
        kernel: settings of every run.
        pipelines: in the order of the file.
        sections: tables that belong to rooms above, as they stand there; see :meth:`section`.
        where: names the file in errors.
        text: the file, so that a run can say what it ran.
    """

    kernel: KernelSettings
    pipelines: tuple[PipelineConfig, ...]
    sections: Mapping[str, Any] = field(default_factory=dict)
    where: str = ""
    text: str = ""

    def section(self, name: str, cls: type[T]) -> T:
        """Return the settings of the table ``[name]``; ``cls`` is a dataclass whose defaults stand where it is silent.

        Raises:
            ConfigError: naming file, key, value found and what is allowed.
        """
        table, where = self.sections.get(name, {}), f"{self.where}: {name}"
        if not isinstance(table, dict):
            raise ConfigError(where, repr(table), f"a table [{name}]")
        hints = typing.get_type_hints(cls, include_extras=True)
        check_keys(where, "", table, list(hints))
        values = {key: convert(f"{where}.{key}", value, hints[key]) for key, value in table.items()}
        return cls(**values)

    def only(self, names: Iterable[str]) -> Config:
        """Return the configuration with just the pipelines named, in the order of the file.

        The name of a table stands for all pipelines of its sweep.

        Raises:
            ConfigError: for a name that it does not have.
        """
        wanted = list(names)
        known = [p.name for p in self.pipelines]
        tables = {p.table for p in self.pipelines}
        for name in wanted:
            if name not in known and name not in tables:
                raise ConfigError("--pipeline", repr(name), one_of(known, name))
        return replace(self, pipelines=tuple(p for p in self.pipelines if p.name in wanted or p.table in wanted))
