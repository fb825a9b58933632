"""Keys: what a result is made from, known before it is made. They decide what Snakemake runs.

The key of a job is a digest of its command and parameters, of the sources and libraries of its programs (see
`beamrider.provenance.sources`), of what its input files mean (YAML without comments, else their bytes) and, for those
that other jobs make, of these jobs' keys; of a checkpoint's output its content. It is a parameter of every job
(`params.key`), so that Snakemake runs a job again where its key changed. A job whose outputs are there, whole and of
its key, asks for no inputs: it is not run again because one of them was touched, deleted, or made again to the same
key.
"""

from __future__ import annotations

import functools
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from snakemake.exceptions import IncompleteCheckpointException
from snakemake.io import IOFile, _IOFile, is_flagged
from snakemake.iocontainers import InputFiles, Wildcards
from snakemake.logging import logger
from snakemake.output_index import OutputIndex
from snakemake.rules import Rule, get_function_params
from snakemake.settings.types import RerunTrigger

from beamrider.io.files import load_yaml
from beamrider.provenance.record import NAME
from beamrider.provenance.sources import digest_of, digest_of_file, program

PROGRAM = re.compile(r"\bpython -m ([\w.]+)")
WILDCARD = re.compile(r"\{wildcards\.(\w+)\}")
#: Folder that tables are shared in, and the command that takes them from there, or makes them and keeps them there.
VARIABLE = "BEAMRIDER_CACHE"
SHARED = (
    "python -m workflow.shared fetch {params.share} {output} > {log} 2>&1"
    " || {{ ( COMMAND ) && python -m workflow.shared store {params.share} {output} >> {log} 2>&1; }}"
)
#: What a function of parameters or inputs must not ask for, to be known before the job runs.
LATER = {"input", "output", "threads", "resources"}
#: Modes in which Snakemake draws or lists the graph: with all its edges.
WHOLE_GRAPH = ("--report", "--dag", "--rulegraph", "--filegraph", "--d3dag", "--touch", "-t", "--archive")

Found = tuple[Rule, dict[str, str]]


def _flat(value: Any) -> list[str]:
    """Paths that an item of `input` stands for."""
    return [str(value)] if isinstance(value, str | Path) else [path for part in value for path in _flat(part)]


def _named_files(data: Any) -> list[str]:
    """Files that scenes and cells name under `file`: measured beams, refractive indices."""
    parts = data.values() if isinstance(data, dict) else data if isinstance(data, list) else ()
    own = [data["file"]] if isinstance(data, dict) and isinstance(data.get("file"), str) else []
    return own + [name for part in parts for name in _named_files(part)]


class Keys:
    """Keys of all jobs of a workflow, and which of their results are current.

    ledger: digests of results (`workflow.ledger`). whole_graph: tell of all inputs. checked: calls a function whose
    InputError ends Snakemake. read: files that were read already, as models.
    """

    def __init__(
        self, workflow: Any, ledger: Any, whole_graph: bool, checked: Callable[..., Any], read: Mapping[str, Any]
    ) -> None:
        self.workflow, self.ledger, self.checked, self._read = workflow, ledger, checked, read
        self._told: set[str] = set()
        self._whole = whole_graph or not workflow.is_main_process
        self._inputs: dict[str, list[tuple[str | None, Any]]] = {}
        self._commands: dict[str, str] = {}
        self._params_before: dict[str, list[tuple[str | None, Any]]] = {}
        self._shared: dict[str, str] = {}
        self._keys: dict[tuple[str, frozenset[tuple[str, str]]], str] = {}
        self._current: dict[tuple[str, frozenset[tuple[str, str]]], bool] = {}

    def shared(self, command: str) -> str:
        """A rule's command; where users share a cache, one that looks there first."""
        if not os.environ.get(VARIABLE):
            return command
        whole = SHARED.replace("COMMAND", command)
        self._shared[whole] = command
        return whole

    def attach(self) -> None:
        """Give every rule that runs a command its key, and its inputs only where it is to be run."""
        for rule in self.workflow.rules:
            if rule.shellcmd:
                self._inputs[rule.name] = list(rule.input._allitems())
                self._commands[rule.name] = self._shared.get(rule.shellcmd, rule.shellcmd)
        for rule in self.workflow.rules:
            if rule.shellcmd:
                self._attach(rule)

    @functools.cached_property
    def _all_inputs(self) -> bool:
        """Are inputs told of current results too? Settles those of Snakemake's own settings that must be so."""
        settings = self.workflow.dag_settings
        settings.rerun_triggers, settings.force_incomplete = frozenset({RerunTrigger.PARAMS}), True
        return bool(self._whole or settings.forceall or settings.forcerun or settings.forcetargets)

    def _attach(self, rule: Rule) -> None:
        def key(wildcards: Wildcards) -> str:
            return self.key(rule, dict(wildcards.items()))

        def gate(wildcards: Wildcards) -> list[str]:
            """No input; where the key hangs on a checkpoint that has yet to run, Snakemake learns that it must wait."""
            key(wildcards)
            return []

        def share(wildcards: Wildcards, resources: Any) -> str:
            """Key in the shared cache: what is accepted of a table may differ from folder to folder."""
            return digest_of([key(wildcards), str(resources.get("accept", ""))])

        self._params_before[rule.name] = [
            (name, item)
            for name, item in rule.params._allitems()
            if not (callable(item) and LATER & set(get_function_params(item)))
        ]
        wrapped = InputFiles()
        for name, item in self._inputs[rule.name]:
            wrapped.append(self._item(rule, item))
            if name:
                wrapped._add_name(name)
        wrapped.append(gate)
        rule._input = wrapped
        rule.set_params(key=key, **({"share": share} if rule.shellcmd in self._shared else {}))

    def _item(self, rule: Rule, item: Any) -> Callable[[Wildcards], Any]:
        """The item of a rule's input, where the job is to be run."""

        def needed(wildcards: Wildcards) -> Any:
            return [] if self.current(rule, dict(wildcards.items())) else self._value(item, wildcards)

        return needed

    @staticmethod
    def _value(item: Any, wildcards: Wildcards) -> Any:
        """What an item of `input` or `params` stands for."""
        if callable(item):
            return item(wildcards)
        if isinstance(item, _IOFile):
            return item.apply_wildcards(dict(wildcards.items()))
        if isinstance(item, str):
            return item.format(**dict(wildcards.items())) if "{" in item else item
        return [Keys._value(part, wildcards) for part in item] if isinstance(item, list) else item

    def of(self, path: str) -> str:
        """Key of the job that makes a file."""
        found = self.producer(path)
        if found is None:
            raise LookupError(f"{path}: no rule makes it")
        return self.key(*found)

    @functools.cached_property
    def _index(self) -> OutputIndex:
        return OutputIndex(list(self.workflow.rules))

    @functools.cache  # noqa: B019 - there is one for as long as Snakemake runs
    def producer(self, path: str) -> Found | None:
        """The rule that makes a file, with its wildcards."""
        rules = [rule for rule in self._index.match_producers(path) if rule.shellcmd]
        return (rules[0], rules[0].get_wildcards(path)) if rules else None

    def key(self, rule: Rule, wildcards: dict[str, str]) -> str:
        """Key of a job. IncompleteCheckpointException where it hangs on a checkpoint that has yet to run."""
        at = rule.name, frozenset(wildcards.items())
        if at not in self._keys:
            command = WILDCARD.sub(lambda found: wildcards[found[1]], self._commands[rule.name])
            self._keys[at] = digest_of(
                [
                    command,
                    [self._program(name) for name in PROGRAM.findall(command)],
                    list(self._params(rule, wildcards)),
                    [self._input_key(path) for path in self._paths(rule, wildcards)],
                ]
            )
        return self._keys[at]

    @functools.cache  # noqa: B019
    def _program(self, name: str) -> str:
        return program(name, Path()).digest

    def _params(self, rule: Rule, wildcards: dict[str, str]) -> Iterator[tuple[str | None, str]]:
        """Parameters that do not follow from files, as text."""
        for name, item in self._params_before[rule.name]:
            yield name, repr(self._value(item, Wildcards(fromdict=wildcards)))

    def _paths(self, rule: Rule, wildcards: dict[str, str]) -> list[str]:
        """Input files of a job that runs; a checkpoint whose output is current counts as done."""
        found: list[str] = []
        for _, item in self._inputs[rule.name]:
            while not is_flagged(item, "ancient"):  # which is there for other reasons than to be read
                try:
                    found += _flat(self._value(item, Wildcards(fromdict=wildcards)))
                    break
                except IncompleteCheckpointException as waits:
                    if not self._settled(str(waits.targetfile)):
                        raise
        return found

    def _settled(self, path: str) -> bool:
        """Is the output of a checkpoint current? Then it counts as done."""
        found = self.producer(path)
        if found is None or not self.current(*found):
            return False
        self.workflow.globals["checkpoints"].created_output.update(found[0].expand_output(found[1])[0])
        return True

    def _input_key(self, path: str) -> str:
        found = self.producer(path)
        if found is None:
            return self._meaning(path)
        rule, wildcards = found
        if not rule.is_checkpoint:
            return self.key(rule, wildcards)
        output = rule.expand_output(wildcards)[0]
        if not set(output) <= set(self.workflow.globals["checkpoints"].created_output) and not self._settled(path):
            raise IncompleteCheckpointException(rule, output[0])
        return self._content(Path(path))

    @staticmethod
    def _content(path: Path) -> str:
        """Digest of what a checkpoint found, without what made it."""
        if path.suffix != ".json":
            return digest_of_file(path)
        data = json.loads(path.read_text(encoding="utf-8"))
        return digest_of({name: value for name, value in data.items() if name not in (NAME, "checksum")})

    @functools.cache  # noqa: B019
    def _meaning(self, path: str) -> str:
        """Digest of what a file means that no job makes; of those that were read already, of what was read."""
        if path in self._read:
            return digest_of(self._read[path].model_dump(mode="json"))
        if Path(path).suffix in (".yaml", ".yml") and Path(path).is_file():
            data = json.loads(json.dumps(self.checked(load_yaml, path), default=str))
            return digest_of([data, *(digest_of_file(Path(name)) for name in _named_files(data))])
        return digest_of_file(Path(path))

    def current(self, rule: Rule, wildcards: dict[str, str]) -> bool:
        """Are all that a job makes there, whole, and made from its key?"""
        at = rule.name, frozenset(wildcards.items())
        if at not in self._current:
            try:
                self._current[at] = not self._all_inputs and self._is_current(rule, wildcards)
            except IncompleteCheckpointException:
                return False
        return self._current[at]

    def _is_current(self, rule: Rule, wildcards: dict[str, str]) -> bool:
        made, records = rule.expand_output(wildcards)[0], self.workflow.persistence
        there = [path for path in made if Path(path).exists()]
        if not there or records._filter_incomplete_keys(list(map(str, made))):
            return False
        recorded = [records.params(IOFile(str(path))) for path in there]
        if None in recorded:
            return self._force(made, "no record of how it was made")
        beside = [rule.expand_benchmark(wildcards)] if rule.benchmark else []
        if len(there) < len(made) or not all(Path(path).exists() for path in beside):
            return False
        if any(repr(self.key(rule, wildcards)) not in params for params in recorded):
            return False
        whole = all(self.ledger.whole(str(path), records.metadata(IOFile(str(path))).endtime) for path in made)
        return whole or self._force(made, "changed since it was made")

    def _force(self, made: list[str], why: str) -> bool:
        """Have Snakemake make files again that it would take for good."""
        self.workflow._dag.forcefiles.update(made)
        for path in sorted(set(map(str, made)) - self._told):
            logger.warning(f"{path}: {why}; it is made again")
        self._told.update(map(str, made))
        return False

    def examine(self) -> None:
        """After jobs failed: was what they read still whole? What a disk spoilt is made again by the next run."""
        left = list(self.workflow._dag.needrun_jobs()) if self.workflow.is_main_process else []
        for path in sorted({str(path) for job in left for path in job.input}):
            self.ledger.examine(path)

    def learn(self) -> None:
        """Write down the digests of all that is there of a run that ends."""
        for job in self.workflow._dag.jobs if self.workflow.is_main_process else ():
            for path in map(str, job.output if job.rule.shellcmd else ()):
                record = self.workflow.persistence.metadata(IOFile(path))
                if record and Path(path).exists():
                    self.ledger.whole(path, record.endtime)
